// SPDX-License-Identifier: Apache-2.0
// A sweep line that passes over closed loops of edges. The sweep finds out whether any two edges
// cross, and how often the loops wind around the points next to each edge. The algorithm follows
// Shamos and Hoey (1976) and computes in exact integers. In this header, n is the number of edges.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "formats/base/result.h"
#include "formats/mesh/slice_mesh.h"

namespace trocar {

/// Closed loops of directed edges. Edge i runs from points[i] to points[next[i]], and each index is
/// in exactly one loop. All points are on the lattice, and the two ends of each edge differ.
struct EdgeLoops {
  std::vector<LatticePoint> points;
  std::vector<std::uint32_t> next, previous;

  /// Adds a ring as one loop.
  void add(std::span<const LatticePoint> ring);
  LatticePoint to(std::uint32_t edge) const { return points[next[edge]]; }
};

/// The indices of the points, sorted by x, then by y, then by index. O(n log n).
std::vector<std::uint32_t> in_sweep_order(std::span<const LatticePoint> points);

struct SweepResult {
  bool crosses = false;  ///< two edges cross (segments_cross()); the sweep has then stopped early
  std::uint32_t first = 0, second = 0;  ///< the two edges that cross
  /// True if the loops wind 0 times around the points just right of every edge. Then they also wind
  /// once around the points just left of every edge, and 0 times or once around every point of the
  /// plane. This member has no meaning if two edges cross, or if some edges were not swept.
  bool winds_once = true;
  std::uint64_t tests = 0;  ///< number of orientation tests, at most 10 n + 3 n log2(n)
};

/// Sweeps over all edges if `is_swept` is empty. Otherwise `is_swept` has one element for each
/// edge, and only edges whose element is not 0 are swept. `order` must be the result of
/// in_sweep_order() for the points of `loops`. If `right_of` is not null and no edges cross,
/// (*right_of)[i] is afterwards the number of times that the loops wind around the points just
/// right of edge i. O(n log n).
SweepResult sweep(const EdgeLoops& loops, std::span<const std::uint32_t> order,
                  std::span<const char> is_swept = {},
                  std::vector<std::int32_t>* right_of = nullptr);

inline constexpr std::uint32_t kNoRing = 0xffffffff;
/// Returns, for each ring, the index of the smallest ring that encloses it, or kNoRing.
/// Precondition: each ring has at least 3 different points. Returns std::nullopt if edges cross, or
/// if rings cross at a common vertex. O(n log n).
std::optional<std::vector<std::uint32_t>> enclosing_rings(const std::vector<Ring>& rings);

/// Makes an Error if a sweep found two edges that cross. Precondition: `swept` is the result of a
/// sweep over all edges. Errors: kRefused with the message "`what` cross near lattice point
/// (x, y)". To choose this point, the function sorts the edges by their smallest x, then by start
/// point, then by end point. In this order, it finds the first edge that crosses an earlier edge;
/// the point is the start of this edge. O(n log^2 n) if two edges cross, else O(1).
Result<void> check_no_crossing(const EdgeLoops& loops, std::span<const std::uint32_t> order,
                               const SweepResult& swept, const char* what);

}  // namespace trocar
