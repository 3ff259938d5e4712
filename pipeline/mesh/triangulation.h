// SPDX-License-Identifier: GPL-3.0-or-later
// The constrained Delaunay triangulation of an outline, without the triangles outside the material
// (which the paper removes by a "triangle-eating virus").
#pragma once

#include "formats/base/result.h"
#include "formats/geometry/slice_mesh.h"
#include "pipeline/mesh/mesh_adjacency.h"

namespace trocar::pipeline {

struct Triangulation {
  SliceMesh mesh;
  Neighbours beyond;
};

/// All triangles of the constrained Delaunay triangulation that lie in the material, as a valid
/// mesh whose boundary is exactly the PSLG: where rings touch, each fan of triangles has its own
/// vertex. `pslg` is valid by check_pslg; fails (bug) where it is found not to be. O(n log n)
/// typically; the flips O(n^2) at worst. All decisions are exact, in a canonical orientation
/// (formats/geometry/canonical_rotation.h): an outline moved or rotated by right angles gives the
/// same mesh, moved and rotated, except for four points on one circle in an outline that a rotation
/// maps onto itself.
Result<Triangulation> triangulate(const Pslg& pslg);

}  // namespace trocar::pipeline
