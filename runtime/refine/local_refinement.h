// SPDX-License-Identifier: Apache-2.0
// Delaunay refinement of a part of a sheet, in place: to a minimum angle and to a size that may
// grow with the distance from something. After Ruppert (1995), with Uengoer's off-centres (2004)
// and, as in Chew's second algorithm (1993), inner vertices that crowd the boundary removed; points
// for size are placed as by Rebay (1993), at the wanted distance from the finest side.
//
// Laws (tests/runtime/refine/local_refinement_test.cpp), for a mesh that is a valid SheetMesh:
//  1. It stays one; where every interior side was locally Delaunay, every one still is.
//  2. The area is unchanged, exactly, but for `doubled_area_lost`; that is 0 without
//     `split_outline`. No material is added anywhere.
//  3. Vertices on the boundary stay; inner ones may be removed where a boundary side is obtuse (the
//     angle opposite it above 90 degrees, its spring's stiffness negative) or a triangle sharp on
//     their account. All that is written is listed in the SheetEdit.
//  4. Triangles that are neither seeds nor replaced are not looked at: time depends on the seeds
//     and on what is added.
//  5. It ends, at the latest with the budget, and never allocates. Same mesh, seeds and options:
//     same result; moved by lattice steps or turned by right angles, without `size` and
//     `split_outline`, the same, moved and turned, to the bit.
//  6. Without `split_outline` each boundary side is part of an old one, and obtuse only if that one
//     was. With it and the outcome kDone no boundary side of the triangles looked at is obtuse,
//     unless it is a kept one.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "runtime/mesh/function_view.h"
#include "runtime/refine/point_insertion.h"
#include "runtime/mesh/sheet_edit.h"
#include "runtime/mesh/sheet_mesh.h"
#include "runtime/refine/triangle_queue.h"
#include "runtime/refine/vertex_removal.h"

namespace trocar::runtime {

/// The length in steps that sides should have, growing linearly with the distance from a disc.
struct GradedSize {
  LatticePoint centre;
  double radius = 0;                                           ///< steps
  double at_radius = std::numeric_limits<double>::infinity();  ///< and everywhere within
  double growth = 0;                                           ///< length per distance
  double largest = std::numeric_limits<double>::infinity();
  double operator()(double x, double y) const noexcept;
};

struct LocalRefinementOptions {
  /// No triangle below this smallest angle where the outline permits; 0: none is asked for. More
  /// than 30 is taken as 30, where the method still ends by itself.
  double min_angle_deg = 20;
  /// Length of sides in steps wanted at a point in steps, for example a GradedSize; empty: any. An
  /// aim: triangles have circumradii up to kLargestRadius times it, and a little more at the
  /// outline.
  FunctionView<double(double x, double y)> size;
  std::uint32_t max_new_vertices = 256;
  /// May sides on the sheet's boundary be split in a lattice point that is not on them? It then
  /// lies less than a step away on the material's side. For meshes that are thrown away: a stored
  /// one keeps its outline, and its sides are split only exactly.
  bool split_outline = false;
  /// Boundary sides between these vertices, in the triangle's direction, are left as they are, such
  /// as a region's border within its sheet; empty: none.
  FunctionView<bool(std::uint32_t from, std::uint32_t to)> keep_side;
};
inline constexpr double kLargestRadius = 0.8;  ///< of the wanted length; equilateral: 0.58

enum class RefinementOutcome {
  kDone,             ///< every triangle looked at is as wanted, as far as counted below
  kOutlineInTheWay,  ///< the same but for those counted in `sharp` and `obtuse_sides`
  kBudget,           ///< stopped at max_new_vertices
  kNoRoom,           ///< stopped: the mesh has no free slot, or more slots than the workspace
};

struct RefinementResult {
  RefinementOutcome outcome = RefinementOutcome::kDone;
  std::uint32_t vertices_added = 0;
  std::uint32_t vertices_removed = 0;
  std::uint32_t sides_split = 0;       ///< of the boundary; part of vertices_added
  std::int64_t doubled_area_lost = 0;  ///< steps^2, >= 0
  /// Of the triangles looked at that are there at the end:
  std::uint32_t looked_at = 0;
  std::uint32_t sharp = 0;             ///< below min_angle_deg
  std::uint32_t sharp_at_outline = 0;  ///< of these: a boundary side was in the way
  std::uint32_t sharp_at_lattice = 0;  ///< of these: too small for lattice points of any use
  std::uint32_t too_large = 0;         ///< circumradius above kLargestRadius
  /// Boundary sides of these triangles with an angle above 90 degrees opposite, but for kept ones.
  std::uint32_t obtuse_sides = 0;
};

/// Kept from one refinement to the next. Room for meshes of so many slots; O(slots).
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

/// Refines `mesh` around the triangles `seeds`; those that are no triangles in use are passed over.
/// `edit` has begun on this mesh, and may hold edits from before. O(k log k) for k triangles that
/// are seeds or new, plus O(entries of `edit`).
RefinementResult refine_locally(SheetMesh& mesh, SheetEdit& edit,
                                std::span<const std::uint32_t> seeds,
                                const LocalRefinementOptions& options,
                                LocalRefinementWorkspace& workspace) noexcept;

}  // namespace trocar::runtime
