// SPDX-License-Identifier: Apache-2.0
// Proofs that a mesh and an outline on the lattice are valid, all in exact integers.
#pragma once

#include <cstdint>
#include <string>

#include "formats/base/result.h"
#include "formats/geometry/proved_outline.h"
#include "formats/geometry/slice_mesh.h"

namespace trocar {

/// Proves that a mesh is valid, or names the first property that fails and the position:
///  - every index is in range and every vertex is used;
///  - every triangle is strictly counter-clockwise;
///  - every directed edge occurs once, so at most two triangles share an edge, in
///    opposite directions;
///  - the triangles at every vertex form one fan, in which each shares an edge with the next (where
///    the boundary touches itself, a valid mesh has two vertices at one point);
///  - no two boundary edges cross.
/// If the boundary also winds exactly once around every point of the material, which
/// check_mesh_against_pslg() proves, the triangles tile the material without overlap. O(n log n).
Result<void> check_mesh(const SliceMesh& mesh);

/// Proves what check_mesh() proves and, in addition, that the mesh's boundary consists of exactly
/// the PSLG's edges, in the same direction, and that mesh and PSLG have the same area. O(n log n).
Result<void> check_mesh_against_pslg(const SliceMesh& mesh, const Pslg& pslg);

/// Like check_mesh_against_pslg(), but for an outline that has already been proved valid. Takes one
/// pass over the mesh.
Result<void> check_mesh_against_outline(const SliceMesh& mesh, const ProvedOutline& outline);
/// Like check_mesh_against_outline(), and in the same pass also proves that every interior edge is
/// locally Delaunay. If only this property fails, the message is "not constrained Delaunay".
Result<void> check_delaunay_mesh(const SliceMesh& mesh, const ProvedOutline& outline);

/// Proves that an outline is valid, or names the first property that fails and the position:
///  - every ring has at least 3 vertices, none of them twice, and all vertices are on the lattice
///    (|coordinates| of at most kMaxCoordinate);
///  - no two edges cross or coincide (rings may touch at vertices);
///  - rings nest: every outer ring lies in no ring or directly in a hole, every hole lies directly
///    in an outer ring, and rings that touch do not cross at the common vertex.
/// In a valid outline, material covers every point of the plane once or not at all. Takes one sweep
/// (outline_sweep.h). O(n log n).
Result<void> check_pslg(const Pslg& pslg);

/// Returns true if a point is inside a simple ring. The point must not lie on the ring. The
/// arguments are twice the point's coordinates, so that the midpoint of an edge can be
/// tested. Exact. O(n).
bool is_inside_ring(std::int64_t doubled_x, std::int64_t doubled_y, const Ring& ring);

/// Returns true if every interior edge is locally Delaunay. Exact. The mesh must be valid.
bool is_constrained_delaunay(const SliceMesh& mesh);

}  // namespace trocar
