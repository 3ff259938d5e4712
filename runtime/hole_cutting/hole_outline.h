// SPDX-License-Identifier: Apache-2.0
// Finds the rings around the material that a cut removes. This is the fourth stage of a cut.
#pragma once

#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "runtime/hole_cutting/patch.h"

namespace trocar::runtime {

/// Rings with exactly the removed material on their left. The removed material is the cavity (the
/// replaced triangles) without the patch (the new triangles). Two rings may touch at vertices. No
/// ring touches or crosses itself, except where cut.h, contract 3, permits it. Each ring starts at
/// its smallest vertex (by x, then y), and the rings are in ascending order.
struct HoleOutline {
  std::vector<LatticePoint> points;     ///< the points of all rings, ring by ring
  std::vector<std::uint32_t> ring_end;  ///< index after the last point of each ring

  std::size_t rings() const noexcept { return ring_end.size(); }
  std::span<const LatticePoint> ring(std::size_t r) const noexcept {
    const std::uint32_t start = r == 0 ? 0 : ring_end[r - 1];
    return std::span(points).subspan(start, ring_end[r] - start);
  }

  // The remaining members are scratch memory.
  /// All edges between two points a and b. An edge from a to b and an edge from b to a cancel.
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
  /// One entry per point of the overlay. `first_out`: the first element of the point's list, as an
  /// index in `out`; kNoSlot if no edge starts at the point. `path_index`: the index of the point
  /// in `path`; kNoSlot if the point is not in `path`.
  std::vector<std::uint32_t> first_out, path_index;
  /// Points, as indices into Overlay::points. `starts`: points at which edges start. `path`: points
  /// of the current walk along the edges. `stops`: the overlay's points on one edge of the cavity's
  /// boundary. `unsorted`: points of the rings found so far, before the rings are sorted.
  std::vector<std::uint32_t> starts, path, stops, unsorted;
  /// Begin and end of each ring in `unsorted`.
  std::vector<std::pair<std::uint32_t, std::uint32_t>> unsorted_rings;

  void allocate(std::size_t max_points, std::size_t max_edges);
};

/// Finds the rings and writes them to `hole`. Returns kBug if the edges around the removed material
/// do not form closed rings.
StageOutcome outline_hole(const Cavity& cavity, const Overlay& overlay, const Patch& patch,
                          HoleOutline& hole) noexcept;

}  // namespace trocar::runtime
