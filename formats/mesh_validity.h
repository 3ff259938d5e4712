// SPDX-License-Identifier: Apache-2.0
// The proofs of DESIGN's "One lattice" on a slice mesh, all in exact integers.
#pragma once

#include <string>

#include "formats/result.h"
#include "formats/slice_mesh.h"

namespace trocar {

/// Proves of a mesh, or names the first thing that fails and where:
///  - every index is in range and every vertex is used;
///  - every triangle is strictly counter-clockwise;
///  - every directed edge occurs once (so at most two triangles share an edge,
///    in opposite directions), and every vertex's triangles form one fan
///    (manifold; a pinch is two vertices at one point);
///  - no two boundary edges cross.
/// With positive triangles these imply a tiling without overlap wherever the
/// boundary winds once. O(n log n).
Result<void> check_mesh(const SliceMesh& mesh);

/// check_mesh, and the mesh's boundary is exactly the PSLG's edges, in their
/// direction, and their areas are equal.
Result<void> check_mesh_against_pslg(const SliceMesh& mesh, const Pslg& pslg);

/// Proves that rings have >= 3 vertices, no repeated consecutive vertex, and that
/// no two edges cross or coincide (touching in vertices is allowed).
Result<void> check_pslg(const Pslg& pslg);

/// Is every interior edge locally Delaunay? Exact. Expects a valid mesh.
bool is_constrained_delaunay(const SliceMesh& mesh);

}  // namespace trocar
