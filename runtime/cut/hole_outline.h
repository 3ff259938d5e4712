// SPDX-License-Identifier: Apache-2.0
// Fourth stage of a cut: the rings around the removed material.
#pragma once

#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "runtime/cut/patch.h"

namespace trocar::runtime {

/// Rings with (cavity minus patch), that is, exactly the removed material, on their left. Simple
/// rings, which may touch in vertices, each starting at its smallest vertex, in ascending order.
struct HoleOutline {
  std::vector<LatticePoint> points;     ///< ring after ring
  std::vector<std::uint32_t> ring_end;  ///< of each, in `points`

  std::size_t rings() const noexcept { return ring_end.size(); }
  std::span<const LatticePoint> ring(std::size_t r) const noexcept {
    const std::uint32_t start = r == 0 ? 0 : ring_end[r - 1];
    return std::span(points).subspan(start, ring_end[r] - start);
  }

  /// Scratch: directed edges, of which opposite ones cancel, as lists by the point where they
  /// start.
  struct CountedEdge {
    std::uint32_t a, b;  ///< a < b, of the overlay's points
    std::int32_t count;  ///< from a to b, less b to a
  };
  struct Out {
    std::uint32_t to, next;
  };
  std::vector<CountedEdge> edges;
  FlatTable edge_at;
  std::vector<Out> out;
  std::vector<std::uint32_t> first_out, place;  ///< by point
  std::vector<std::uint32_t> starts, path, stops, unsorted;
  std::vector<std::pair<std::uint32_t, std::uint32_t>> unsorted_rings;  ///< start and end

  void allocate(std::size_t max_points, std::size_t max_edges);
};

/// kBug: rim and patch do not bound an area.
StageOutcome outline_hole(const Cavity& cavity, const Overlay& overlay, const Patch& patch,
                          HoleOutline& hole) noexcept;

}  // namespace trocar::runtime
