// SPDX-License-Identifier: Apache-2.0
// Finds the cavity of a cut, which consists of the triangles that the tool overlaps or touches.
// This is the first stage of a cut. (The paper describes it in II.C as "search all meshes that are
// across the hexagon by intersection test and all vertices inside the hexagon". In the paper,
// meshes are triangles, and the hexagon is the tool's outline.) This stage also finds the boundary
// of the cavity. The triangles outside the cavity are the kept triangles. All intersection tests
// are exact, because they use 64-bit and 128-bit integers.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "formats/mesh/flat_table.h"
#include "formats/mesh/sheet_mesh.h"
#include "formats/mesh/slice_mesh.h"
#include "formats/mesh/triangle_grid.h"

namespace trocar {

/// Largest number of corners of a tool's outline.
inline constexpr std::size_t kMaxToolCorners = 32;

/// A tool's outline: a counter-clockwise polygon that neither crosses nor touches itself.
using Outline = std::span<const LatticePoint>;

/// An edge of an outline, with its bounding box.
struct OutlineEdge {
  LatticePoint a, b;
  LatticeBox box;
};

/// How a stage of a cut has ended.
enum class StageOutcome : std::uint8_t {
  kDone,
  /// Rounding would change kept triangles. The caller adds the triangles that the stage lists in
  /// `absorb` to the cavity, and repeats the stages.
  kAgain,
  kCapacity,  ///< the scratch memory is too small
  kBug,       ///< an invariant does not hold
};

enum class ToolIntersection : std::uint8_t {
  kApart,     ///< triangle and tool have no point in common, not even on their boundaries
  kTouches,   ///< they have common points, but no common area
  kOverlaps,  ///< they have a common area
};

/// Classifies the intersection of a triangle (counter-clockwise) with the tool. O(tool size).
ToolIntersection intersect_tool(const std::array<LatticePoint, 3>& triangle,
                                std::span<const OutlineEdge> tool) noexcept;

/// Returns true if p is outside the tool and not on the tool's boundary. O(tool size).
bool strictly_outside(LatticePoint p, std::span<const OutlineEdge> tool) noexcept;

/// A directed edge of the cavity's boundary, with the cavity on its left.
struct CavityBoundaryEdge {
  std::uint32_t from, to;   ///< indices into Cavity::boundary_vertices
  std::uint32_t kept;       ///< the kept triangle beyond the edge; kNoSlot on the sheet's boundary
  std::uint32_t kept_edge;  ///< number of this edge in the triangle `kept`
};

struct Cavity {
  std::vector<OutlineEdge> tool;  ///< the tool's outline, given to find_cavity()
  LatticeBox tool_box;
  std::vector<std::uint32_t> near_tool;          ///< triangles whose boxes overlap the tool's box
  std::vector<std::uint32_t> triangles;          ///< the cavity's triangles, in ascending order
  std::vector<CavityBoundaryEdge> boundary;      ///< the edges of the cavity's boundary
  std::vector<std::uint32_t> boundary_vertices;  ///< vertices on the cavity's boundary, each once
  std::vector<std::uint32_t> inner;              ///< the other vertices of the cavity's triangles
  FlatTable members;                             ///< `triangles` as a set
  /// All vertices of the cavity's triangles. Key: vertex; value: index in
  /// boundary_vertices, or kInner for a vertex in `inner`.
  FlatTable vertices;
  static constexpr std::uint32_t kInner = kNoSlot - 1;

  void allocate(std::size_t max_triangles);
  bool contains(std::uint32_t t) const noexcept { return members.contains(t); }
};

/// Finds the triangles that the tool overlaps or touches, so that the tool has no point in common
/// with a kept triangle. If the tool only touches triangles and overlaps none, there is nothing to
/// cut, and the cavity is empty. The time is proportional to the number of triangles near the tool.
StageOutcome find_cavity(const SheetMesh& mesh, const TriangleGrid& grid, Outline tool,
                         Cavity& cavity) noexcept;

/// Adds triangles to the cavity. Triangles that are already in the cavity are skipped. Call
/// trace_boundary() afterwards.
StageOutcome enlarge_cavity(std::span<const std::uint32_t> triangles, Cavity& cavity) noexcept;

/// Determines the boundary of the cavity (`boundary`, `boundary_vertices`) and the vertices inside
/// the cavity (`inner`).
void trace_boundary(const SheetMesh& mesh, Cavity& cavity) noexcept;

}  // namespace trocar
