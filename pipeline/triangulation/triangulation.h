// SPDX-License-Identifier: GPL-3.0-or-later
// The constrained Delaunay triangulation of an outline, without the triangles outside the material
// (which the paper removes by a "triangle-eating virus").
#pragma once

#include "formats/base/result.h"
#include "formats/geometry/slice_mesh.h"
#include "pipeline/triangulation/mesh_adjacency.h"

namespace trocar::pipeline {

struct Triangulation {
  SliceMesh mesh;
  Neighbours beyond;
};

/// Returns all triangles of the constrained Delaunay triangulation that lie in the material. They
/// form a valid mesh whose boundary is exactly the PSLG. Where rings touch in a point, the
/// triangles around this point form several fans; each fan has its own vertex. Precondition: `pslg`
/// is valid by check_pslg. O(n log n) typically; the flips are O(n^2) at worst. Errors: kBug if
/// `pslg` is found to be invalid.
///
/// All decisions are exact, in a canonical orientation (formats/geometry/canonical_rotation.h). So
/// if the outline is moved or rotated by right angles, the mesh moves and rotates with it. The only
/// exception is an outline that a rotation maps onto itself and that has four points on one circle.
Result<Triangulation> triangulate(const Pslg& pslg);

}  // namespace trocar::pipeline
