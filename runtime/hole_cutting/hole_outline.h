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
/// are simple and may touch at vertices. Each ring starts at its smallest vertex, and the rings are
/// in ascending order.
struct HoleOutline {
  std::vector<LatticePoint> points;     ///< the points of all rings, ring by ring
  std::vector<std::uint32_t> ring_end;  ///< index after the last point of each ring

  std::size_t rings() const noexcept { return ring_end.size(); }
  std::span<const LatticePoint> ring(std::size_t r) const noexcept {
    const std::uint32_t start = r == 0 ? 0 : ring_end[r - 1];
    return std::span(points).subspan(start, ring_end[r] - start);
  }

  // The remaining members are working memory.
  /// A set of equal edges. Edges in opposite directions cancel.
  struct CountedEdge {
    std::uint32_t a, b;  ///< points of the overlay, a < b
    std::int32_t count;  ///< number of edges from a to b minus the number from b to a
  };
  /// An element of the list of edges that start at the same point.
  struct Out {
    std::uint32_t to, next;
  };
  std::vector<CountedEdge> edges;
  FlatTable edge_at;
  std::vector<Out> out;
  std::vector<std::uint32_t> first_out, path_index;  ///< each point's list, and index in the path
  std::vector<std::uint32_t> starts, path, stops, unsorted;
  std::vector<std::pair<std::uint32_t, std::uint32_t>> unsorted_rings;  ///< ranges of `unsorted`

  void allocate(std::size_t max_points, std::size_t max_edges);
};

/// Determines the rings of `hole`. Returns kBug if rim and patch do not bound an area.
StageOutcome outline_hole(const Cavity& cavity, const Overlay& overlay, const Patch& patch,
                          HoleOutline& hole) noexcept;

}  // namespace trocar::runtime
