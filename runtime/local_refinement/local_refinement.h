// SPDX-License-Identifier: Apache-2.0
// Delaunay refinement of a part of a sheet, in place. It guarantees a minimum angle, and a size of
// triangles that may grow with the distance from a point. The method is Ruppert's (1995), with
// Uengoer's off-centres (2004). As in Chew's second algorithm (1993), inner vertices too near to
// the boundary are removed. A point that is inserted because of the size has the wanted distance
// from the triangle's shortest edge (Rebay, 1993).
//
// Contract (tests/runtime/local_refinement/local_refinement_test.cpp), for a valid SheetMesh:
//  1. The mesh stays valid. If every inner edge was locally Delaunay, every inner edge still is.
//  2. The area is unchanged except for `doubled_area_lost`, exactly. Without `split_outline` this
//     loss is 0. The area covered by material never grows.
//  3. Vertices on the boundary stay. Inner vertices may be removed if they make a triangle sharp
//     (with an angle below min_angle_deg) or a boundary edge obtuse. An edge is obtuse if the angle
//     opposite to it is above 90 degrees, so that its spring's stiffness is negative. The SheetEdit
//     lists all slots written.
//  4. Only seeds and new triangles are inspected, so the time depends only on their number.
//  5. The function terminates, at the latest after max_new_vertices, and never allocates. The same
//     mesh, seeds and options give the same result. If the mesh is moved by lattice steps or
//     rotated by right angles, the result moves and rotates with it, bit by bit, provided that
//     neither `size` nor `split_outline` is used.
//  6. Without `split_outline` each boundary edge is part of an old boundary edge, and is obtuse
//     only if the old one was. With `split_outline` and the outcome kDone, no boundary edge of an
//     inspected triangle is obtuse, except edges for which `keep_edge` is true.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "runtime/local_refinement/point_insertion.h"
#include "runtime/local_refinement/triangle_queue.h"
#include "runtime/local_refinement/vertex_removal.h"
#include "runtime/sheet_mesh/function_ref.h"
#include "runtime/sheet_mesh/sheet_edit.h"
#include "runtime/sheet_mesh/sheet_mesh.h"

namespace trocar::runtime {

/// Wanted length of edges, in lattice steps. It grows linearly with the distance from a disc.
struct GradedSize {
  LatticePoint centre;
  double radius = 0;                                           ///< radius of the disc, steps
  double at_radius = std::numeric_limits<double>::infinity();  ///< wanted length in the disc
  double growth = 0;  ///< growth of the length per distance
  double largest = std::numeric_limits<double>::infinity();
  double operator()(double x, double y) const noexcept;
};

struct LocalRefinementOptions {
  /// Smallest angle of a triangle, where the outline permits it; 0 allows any angle. A value above
  /// 30 is treated as 30, because the method is sure to terminate only up to this angle.
  double min_angle_deg = 20;
  /// Wanted length of edges, in steps, at the point (x, y), in steps; for example a GradedSize. If
  /// empty, any length is allowed. The circumradius of a triangle is at most kMaxRadius times the
  /// wanted length, and may be slightly larger at the outline.
  FunctionRef<double(double x, double y)> size;
  std::uint32_t max_new_vertices = 256;
  /// True: boundary edges may be split at a lattice point next to them, less than a step away on
  /// the material's side. This is meant for temporary meshes. False: edges are split only at
  /// lattice points on them, so that the outline does not change.
  bool split_outline = false;
  /// A boundary edge is not changed if this returns true for its ends, which are given in the
  /// triangle's direction. An example is a region's border within its sheet. If empty, any boundary
  /// edge may be split.
  FunctionRef<bool(std::uint32_t from, std::uint32_t to)> keep_edge;
};
/// Largest circumradius as a fraction of the wanted length. (An equilateral triangle has 0.58.)
inline constexpr double kMaxRadius = 0.8;

enum class LocalRefinementOutcome {
  kDone,              ///< no inspected triangle is sharp, and no boundary edge of one is obtuse
  kLimitedByOutline,  ///< like kDone, except for those counted in `sharp` and `obtuse_edges`
  kBudget,            ///< stopped at max_new_vertices
  kCapacity,          ///< stopped because the mesh has no free slot or the workspace is too small
};

struct LocalRefinementResult {
  LocalRefinementOutcome outcome = LocalRefinementOutcome::kDone;
  std::uint32_t vertices_added = 0;
  std::uint32_t vertices_removed = 0;
  std::uint32_t edges_split = 0;       ///< boundary edges split; included in vertices_added
  std::int64_t doubled_area_lost = 0;  ///< steps^2, >= 0
  std::uint32_t inspected = 0;         ///< number of inspected triangles that exist at the end
  std::uint32_t sharp = 0;             ///< number of these with an angle below min_angle_deg
  std::uint32_t sharp_at_outline = 0;  ///< sharp triangles whose improvement the outline blocks
  std::uint32_t sharp_at_lattice = 0;  ///< sharp triangles that no lattice point improves
  std::uint32_t too_large = 0;         ///< inspected triangles above kMaxRadius
  /// Number of boundary edges of inspected triangles that are opposite an angle above 90 degrees,
  /// not counting those for which keep_edge is true.
  std::uint32_t obtuse_edges = 0;
};

/// Memory that is reused from one refinement to the next, for meshes with at most the given numbers
/// of slots. O(slots).
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
  // Both are 0 between refinements.
  std::vector<std::uint8_t> marks_;   // by triangle slot
  std::vector<std::uint8_t> is_new_;  // by vertex slot
};

/// Refines `mesh` around the triangles `seeds`. Slots that are not in use are skipped.
/// SheetEdit::begin() must have been called for this mesh. `edit` may already list earlier changes.
/// The time is O(k log k) for k triangles that are seeds or new, plus O(entries of `edit`).
LocalRefinementResult refine_locally(SheetMesh& mesh, SheetEdit& edit,
                                     std::span<const std::uint32_t> seeds,
                                     const LocalRefinementOptions& options,
                                     LocalRefinementWorkspace& workspace) noexcept;

}  // namespace trocar::runtime
