// SPDX-License-Identifier: GPL-3.0-or-later
// The constrained Delaunay triangulation of an outline, with what lies outside the material
// removed (the paper's "triangle-eating virus").
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
/// mesh whose boundary is exactly the PSLG: where rings touch, each fan of triangles has a vertex
/// of its own. `pslg` is valid by check_pslg. Fails (bug) if the
/// outline turns out not to be. O(n log n) typically; the flips O(n^2) at worst. Deterministic:
/// only integers decide, in a plane that the outline turns to its own liking (quarter_turn.h):
/// moved or turned by right angles it gives the same, moved and turned, but for four points on one
/// circle in an outline that a turn brings onto itself.
Result<Triangulation> triangulate(const Pslg& pslg);

}  // namespace trocar::pipeline
