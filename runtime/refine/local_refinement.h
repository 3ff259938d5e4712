// SPDX-License-Identifier: Apache-2.0
// Delaunay refinement of a part of a sheet, in place: to a minimum angle and to a size that may
// grow with the distance from a place. After Ruppert (1995), with Uengoer's off-centres (2004) and,
// as in Chew's second algorithm (1993), removal of inner vertices too near the boundary; points for
// size are placed as by Rebay (1993), at the wanted distance from the finest edge.
//
// Contract (tests/runtime/refine/local_refinement_test.cpp), for a mesh that is a valid SheetMesh:
//  1. It stays one; if every inner edge was locally Delaunay, every one still is.
//  2. The area is unchanged, exactly, except for `doubled_area_lost`; that is 0 without
//     `split_outline`. No material is added anywhere.
//  3. Vertices on the boundary stay; inner ones may be removed if they make a boundary edge obtuse
//     (the angle opposite it above 90 degrees, its spring's stiffness negative) or a triangle
//     sharp. All slots written are listed in the SheetEdit.
//  4. Triangles that are neither seeds nor new are not looked at: time depends on the seeds and on
//     what is added.
//  5. It ends, at the latest after max_new_vertices, and never allocates. Same mesh, seeds and
//     options: same result. Moved by lattice steps or rotated by right angles, without `size` and
//     `split_outline`: the same result, moved and rotated, to the bit.
//  6. Without `split_outline` each boundary edge is part of an old one, and obtuse only if that one
//     was. With it and the outcome kDone no boundary edge of the triangles looked at is obtuse,
//     unless it is a kept one.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "runtime/mesh/function_view.h"
#include "runtime/mesh/sheet_edit.h"
#include "runtime/mesh/sheet_mesh.h"
#include "runtime/refine/point_insertion.h"
#include "runtime/refine/triangle_queue.h"
#include "runtime/refine/vertex_removal.h"

namespace trocar::runtime {

/// The length in steps that edges should have, growing linearly with the distance from a disc.
struct GradedSize {
  LatticePoint centre;
  double radius = 0;                                           ///< steps
  double at_radius = std::numeric_limits<double>::infinity();  ///< and everywhere within
  double growth = 0;                                           ///< length per distance
  double largest = std::numeric_limits<double>::infinity();
  double operator()(double x, double y) const noexcept;
};

struct LocalRefinementOptions {
  /// Smallest angle of a triangle, where the outline permits; 0: any. More than 30 is taken as 30,
  /// with which the method still terminates.
  double min_angle_deg = 20;
  /// Wanted length of edges, in steps, at a point in steps, for example a GradedSize; empty: any.
  /// Triangles get circumradii up to kLargestRadius times it, and slightly more at the outline.
  FunctionView<double(double x, double y)> size;
  std::uint32_t max_new_vertices = 256;
  /// May boundary edges be split at a lattice point that is not on them? It then lies less than a
  /// step away on the material's side. For temporary meshes: a stored mesh keeps its outline, and
  /// its edges are split only at lattice points on them.
  bool split_outline = false;
  /// Boundary edges between these vertices, in the triangle's direction, are left as they are, such
  /// as a region's border within its sheet; empty: none.
  FunctionView<bool(std::uint32_t from, std::uint32_t to)> keep_edge;
};
inline constexpr double kLargestRadius = 0.8;  ///< of the wanted length; equilateral: 0.58

enum class LocalRefinementOutcome {
  kDone,              ///< no triangle looked at is sharp, and no boundary edge of one obtuse
  kLimitedByOutline,  ///< the same except for those counted in `sharp` and `obtuse_edges`
  kBudget,            ///< stopped at max_new_vertices
  kCapacity,          ///< stopped: the mesh has no free slot, or more slots than the workspace
};

struct LocalRefinementResult {
  LocalRefinementOutcome outcome = LocalRefinementOutcome::kDone;
  std::uint32_t vertices_added = 0;
  std::uint32_t vertices_removed = 0;
  std::uint32_t edges_split = 0;       ///< of the boundary; part of vertices_added
  std::int64_t doubled_area_lost = 0;  ///< steps^2, >= 0
  /// Of the triangles looked at that exist at the end:
  std::uint32_t looked_at = 0;
  std::uint32_t sharp = 0;             ///< below min_angle_deg
  std::uint32_t sharp_at_outline = 0;  ///< of these: a boundary edge was in the way
  std::uint32_t sharp_at_lattice = 0;  ///< of these: no lattice point improves them
  std::uint32_t too_large = 0;         ///< circumradius above kLargestRadius
  /// Boundary edges of these triangles with an angle above 90 degrees opposite, kept ones excepted.
  std::uint32_t obtuse_edges = 0;
};

/// Memory to be kept from one refinement to the next, for meshes of up to so many slots. O(slots).
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
  // 0 between refinements:
  std::vector<std::uint8_t> marks_;   // by triangle slot
  std::vector<std::uint8_t> is_new_;  // by vertex slot
};

/// Refines `mesh` around the triangles `seeds`; slots that are not in use are skipped. `edit` has
/// begun on this mesh, and may list earlier edits. O(k log k) for k triangles that
/// are seeds or new, plus O(entries of `edit`).
LocalRefinementResult refine_locally(SheetMesh& mesh, SheetEdit& edit,
                                     std::span<const std::uint32_t> seeds,
                                     const LocalRefinementOptions& options,
                                     LocalRefinementWorkspace& workspace) noexcept;

}  // namespace trocar::runtime
