// SPDX-License-Identifier: Apache-2.0
// Refines a part of a sheet, in place: inserts vertices until the triangles have a minimum angle,
// where the outline permits it. On request it also limits the size of the triangles, and this limit
// may grow with the distance from a point. The method is Ruppert's Delaunay refinement (1995), with
// Uengoer's off-centres (2004) as positions of new vertices. As in Chew's second algorithm (1993),
// inner vertices can also be removed (contract 3). If a triangle is too large, the new vertex is
// placed so that, where possible, its distance from both ends of the triangle's shortest edge is
// the wanted length of edges (Rebay, 1993).
//
// Contract (tests/runtime/local_refinement/local_refinement_test.cpp), for a valid SheetMesh:
//  1. The mesh stays valid. An inner edge (between two triangles) is locally Delaunay if the two
//     angles opposite the edge add up to at most 180 degrees. If every inner edge was locally
//     Delaunay, every inner edge still is.
//  2. Twice the mesh's area falls by exactly `doubled_area_lost`. Without `split_outline` this is
//     0. No point outside the material becomes material.
//  3. Vertices on the boundary stay. Inner vertices may be removed if they make a triangle sharp
//     or a boundary edge obtuse, but not if this refinement has added them. A triangle is sharp if
//     it has an angle below min_angle_deg. A boundary edge is obtuse if the angle opposite the
//     edge is above 90 degrees, so that the edge's spring has a negative stiffness. The SheetEdit
//     lists all slots written.
//  4. Only the seeds (the triangles at which the caller starts the refinement) and new triangles
//     are inspected, so the time does not depend on the size of the sheet.
//  5. The function terminates, at the latest after max_new_vertices new vertices, and never
//     allocates. The same mesh, seeds and options give the same result. If neither `size` nor
//     `split_outline` is used, and the mesh is moved by lattice steps or rotated by right angles,
//     the result moves and rotates with it, bit by bit.
//  6. Without `split_outline` each boundary edge is an old boundary edge or a part of an old one.
//     It is obtuse only if the old edge was obtuse. With `split_outline` and the outcome kDone, no
//     boundary edge of an inspected triangle is obtuse, except edges for which `keep_edge` is true.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "runtime/local_refinement/point_insertion.h"
#include "runtime/local_refinement/triangle_queue.h"
#include "runtime/local_refinement/vertex_removal.h"
#include "runtime/sheet_mesh/function_ref.h"
#include "runtime/sheet_mesh/sheet_edit.h"
#include "runtime/sheet_mesh/sheet_mesh.h"

namespace trocar::runtime {

struct LocalRefinementOptions {
  /// Smallest angle of a triangle, where the outline permits it; 0 allows any angle. A value above
  /// 30 is treated as 30, because with larger angles the method might not come to an end before it
  /// has added max_new_vertices vertices.
  double min_angle_deg = 20;
  /// Wanted length of edges at the point (x, y). Length and coordinates are in steps. If empty, any
  /// length is allowed. A triangle is too large if its circumradius is above kMaxRadius times the
  /// wanted length at its centroid. At the outline, triangles that are too large may remain. Their
  /// size alone is no reason to split a boundary edge.
  FunctionRef<double(double x, double y)> size;
  std::uint32_t max_new_vertices = 256;  ///< refinement stops after this many new vertices
  /// True: a boundary edge may be split at a lattice point beside the edge, less than a step from
  /// the edge on the material's side. The sheet then loses a little area, so this is meant for
  /// temporary meshes. False: a boundary edge is split only at a lattice point on the edge, so that
  /// the outline does not change.
  bool split_outline = false;
  /// Returns true for a boundary edge that must not be split, for example because a part of a sheet
  /// was copied and the edge is the part's border to the rest of the sheet. `from` and `to` are the
  /// edge's ends, in the direction in which the edge runs in its triangle. If empty, any boundary
  /// edge may be split.
  FunctionRef<bool(std::uint32_t from, std::uint32_t to)> keep_edge;
};
/// Largest allowed circumradius of a triangle, as a fraction of the wanted length of edges. (In an
/// equilateral triangle the circumradius is 0.58 times the edge length.)
inline constexpr double kMaxRadius = 0.8;

enum class LocalRefinementOutcome {
  kDone,              ///< finished: `sharp` and `obtuse_edges` are 0
  kLimitedByOutline,  ///< finished, but `sharp` or `obtuse_edges` is above 0
  kBudget,            ///< stopped after max_new_vertices new vertices
  kCapacity,          ///< stopped: no slot of the mesh is free, or the scratch memory is too small
};

struct LocalRefinementResult {
  LocalRefinementOutcome outcome = LocalRefinementOutcome::kDone;
  std::uint32_t vertices_added = 0;
  std::uint32_t vertices_removed = 0;
  std::int64_t doubled_area_lost = 0;  ///< twice the area that the mesh lost, steps^2, >= 0
  std::uint32_t inspected = 0;         ///< number of inspected triangles that exist at the end
  std::uint32_t sharp = 0;             ///< inspected triangles with an angle below min_angle_deg
  std::uint32_t sharp_at_outline = 0;  ///< sharp triangles that remain because of the outline
  std::uint32_t sharp_at_lattice = 0;  ///< sharp triangles that remain because of rounding
  std::uint32_t too_large = 0;         ///< inspected triangles larger than `size` allows
  /// Number of obtuse boundary edges (contract 3) of inspected triangles, not counting edges for
  /// which keep_edge is true.
  std::uint32_t obtuse_edges = 0;
};

/// Scratch memory that is reused from one refinement to the next, for meshes with at most the given
/// numbers of slots. Construction takes O(slots).
class LocalRefinementWorkspace {
 public:
  LocalRefinementWorkspace(std::size_t vertex_slots, std::size_t triangle_slots);
  explicit LocalRefinementWorkspace(const SheetMesh& mesh)
      : LocalRefinementWorkspace(mesh.vertices.size(), mesh.triangles.size()) {}

 private:
  friend class LocalRefiner;
  PointInsertion insertion_;
  VertexRemoval removal_;
  TriangleQueue queue_;
  // Notes of LocalRefiner. All elements are 0 between refinements.
  std::vector<std::uint8_t> marks_;   // marks_[t]: bits of triangle slot t, such as "inspected"
  std::vector<std::uint8_t> is_new_;  // is_new_[v] is 1 if this refinement added vertex slot v
};

/// Refines `mesh` around the triangles `seeds`. Seeds whose slots are not in use are skipped.
/// Precondition: SheetEdit::begin() has been called for this mesh. `edit` may already list earlier
/// changes. The time is O(k log k) for k triangles that are seeds or new, plus O(entries of
/// `edit`).
LocalRefinementResult refine_locally(SheetMesh& mesh, SheetEdit& edit,
                                     std::span<const std::uint32_t> seeds,
                                     const LocalRefinementOptions& options,
                                     LocalRefinementWorkspace& workspace) noexcept;

}  // namespace trocar::runtime
