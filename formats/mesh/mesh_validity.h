// SPDX-License-Identifier: Apache-2.0
// Proofs that meshes and outlines are valid.
#pragma once

#include <cstdint>
#include <utility>

#include "formats/base/result.h"
#include "formats/mesh/slice_mesh.h"

namespace trocar {

// An outline that is proved valid, for example without edges that cross. A function that takes a
// ProvedOutline need not prove the outline again.

class ProvedOutline {
 public:
  /// The empty outline.
  ProvedOutline() = default;
  /// Checks the outline by check_pslg() (mesh_validity.h) and wraps it. Errors: those of
  /// check_pslg(). O(n log n).
  static Result<ProvedOutline> of(Pslg pslg);

  const Pslg& pslg() const { return pslg_; }

 private:
  explicit ProvedOutline(Pslg pslg) : pslg_(std::move(pslg)) {}
  Pslg pslg_;
};

// Proofs that a mesh or an outline on the lattice is valid, all in exact integers. Each check_...()
// returns success, or an Error (kRefused) that names a property that fails and, for most
// properties, the position.

/// Proves that a mesh is valid:
///  - every index is in range, and every vertex is on the lattice and used;
///  - every triangle is strictly counter-clockwise;
///  - every directed edge occurs once, so at most two triangles share an edge, in opposite
///    directions;
///  - the triangles at every vertex form one fan: each triangle of the fan shares an edge with the
///    next. (Where the boundary touches itself, a valid mesh has two vertices at one point.)
///  - no two boundary edges cross.
/// The triangles may still overlap; check_mesh_against_pslg() proves that they do not. O(n log n).
Result<void> check_mesh(const SliceMesh& mesh);

/// Proves what check_mesh() and check_pslg() prove. Proves also that the mesh's boundary consists
/// of exactly the PSLG's edges, in the same directions, and that mesh and PSLG have the same area.
/// So the triangles tile the material without overlap. O(n log n).
Result<void> check_mesh_against_pslg(const SliceMesh& mesh, const Pslg& pslg);

/// Like check_mesh_against_pslg(), but for an outline that has already been proved valid.
Result<void> check_mesh_against_outline(const SliceMesh& mesh, const ProvedOutline& outline);
/// Like check_mesh_against_outline(), and proves also that every interior edge is locally Delaunay
/// (predicates.h). If only this property fails, the message is "not constrained Delaunay".
Result<void> check_delaunay_mesh(const SliceMesh& mesh, const ProvedOutline& outline);

/// Proves that an outline is valid:
///  - every ring has at least 3 vertices, no ring has a vertex twice, and every vertex is on the
///    lattice (|coordinates| of at most kMaxCoordinate);
///  - no two edges cross or coincide (rings may touch at vertices);
///  - rings nest: every outer ring lies in no ring or directly in a hole (without a ring between
///    them), every hole lies directly in an outer ring, and rings that touch do not cross at the
///    common vertex.
/// A valid outline winds once around every point of the material, and 0 times around every other
/// point. O(n log n).
Result<void> check_pslg(const Pslg& pslg);

/// Returns true if a point is inside a simple ring. Precondition: the point is not on the ring. The
/// arguments are twice the point's coordinates, so that the midpoint of an edge can be tested, too.
/// Exact. O(n).
bool is_inside_ring(std::int64_t doubled_x, std::int64_t doubled_y, const Ring& ring);

/// Returns true if every interior edge is locally Delaunay. Exact. Precondition: a valid mesh.
bool is_constrained_delaunay(const SliceMesh& mesh);

}  // namespace trocar
