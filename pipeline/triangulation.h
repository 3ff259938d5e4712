// SPDX-License-Identifier: GPL-3.0-or-later
// The constrained Delaunay triangulation of an outline, with what lies outside the material
// removed (the paper's "triangle-eating virus").
#pragma once

#include "formats/result.h"
#include "formats/slice_mesh.h"

namespace trocar::pipeline {

/// All triangles of the constrained Delaunay triangulation that lie in the material, as a valid
/// mesh whose boundary is exactly the PSLG: where rings touch, each fan of triangles has a vertex
/// of its own. `pslg` is valid by check_pslg. Fails (bug) if the
/// outline turns out not to be. O(n log n) typically; the flips O(n^2) at worst. Deterministic:
/// only integers decide.
Result<SliceMesh> triangulate(const Pslg& pslg);

/// Gives each fan of triangles around a point a vertex of its own, drops unused vertices.
SliceMesh split_pinches(SliceMesh mesh);

}  // namespace trocar::pipeline
