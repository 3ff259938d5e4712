// SPDX-License-Identifier: Apache-2.0
// Fourth stage of a cut: the rings around the removed material.
// Tests: tests/runtime/hole_cutting/cut_test.cpp
#pragma once

#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "runtime/hole_cutting/patch.h"

namespace trocar::runtime {

/// Rings with exactly the removed material (the cavity minus the patch) on their left. The rings
/// may touch at vertices. Each ring is simple, except where cut.h, contract 3, lets rings cross
/// themselves. Each ring starts at its smallest vertex (by x, then y), and the rings are in
/// ascending order.
struct HoleOutline {
  std::vector<LatticePoint> points;     ///< the points of all rings, ring by ring
  std::vector<std::uint32_t> ring_end;  ///< index after the last point of each ring

  std::size_t rings() const noexcept { return ring_end.size(); }
  std::span<const LatticePoint> ring(std::size_t r) const noexcept {
    const std::uint32_t start = r == 0 ? 0 : ring_end[r - 1];
    return std::span(points).subspan(start, ring_end[r] - start);
  }

  // The remaining members are scratch memory.
  /// All edges between the same two points. Edges in opposite directions cancel.
  struct CountedEdge {
    std::uint32_t a, b;  ///< indices into Overlay::points, a < b
    std::int32_t count;  ///< number of edges from a to b minus the number from b to a
  };
  /// An element of a linked list of all edges that start at the same point.
  struct Out {
    std::uint32_t to, next;  ///< end point of the edge; index of the list's next element in `out`
  };
  std::vector<CountedEdge> edges;
  FlatTable edge_at;  ///< key: a and b of a CountedEdge; value: index into `edges`
  std::vector<Out> out;
  /// One entry per point of the overlay. `first_out`: index in `out` of the first element of the
  /// point's list. `path_index`: index of the point in `path`. kNone: there is none.
  std::vector<std::uint32_t> first_out, path_index;
  /// Points, as indices into Overlay::points. `starts`: points at which edges start. `path`: points
  /// of the present walk along the edges. `stops`: ends and inner points of one edge that was bent.
  /// `unsorted`: points of the rings found so far.
  std::vector<std::uint32_t> starts, path, stops, unsorted;
  std::vector<std::pair<std::uint32_t, std::uint32_t>> unsorted_rings;  ///< ranges of `unsorted`

  void allocate(std::size_t max_points, std::size_t max_edges);
};

/// Finds the rings and writes them to `hole`. Returns kBug if the edges around the removed material
/// do not form closed rings.
StageOutcome outline_hole(const Cavity& cavity, const Overlay& overlay, const Patch& patch,
                          HoleOutline& hole) noexcept;

}  // namespace trocar::runtime
