// SPDX-License-Identifier: Apache-2.0
// One sweep over closed loops of edges: does any of them cross another, and how often do the loops
// wind around the points beside each edge? After Shamos and Hoey (1976), exact in integers.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "formats/base/result.h"
#include "formats/geometry/slice_mesh.h"

namespace trocar {

/// Closed loops of directed edges. Edge i runs from points[i] to points[next[i]]; both ends are on
/// the lattice and differ. Every point is in exactly one loop.
struct EdgeLoops {
  std::vector<LatticePoint> points;
  std::vector<std::uint32_t> next, previous;

  void add(std::span<const LatticePoint> ring);
  void reserve(std::size_t size);
  LatticePoint to(std::uint32_t edge) const { return points[next[edge]]; }
};

/// The numbers of the points, ascending by point and number. O(n log n).
std::vector<std::uint32_t> in_sweep_order(std::span<const LatticePoint> points);

struct SweepResult {
  bool crosses = false;  ///< two edges, by segments_cross(); if so, the sweep stopped there
  std::uint32_t first = 0, second = 0;  ///< these two
  /// Do the loops wind 0 times around the points just right of every edge, and so once around those
  /// just left of it? Then they wind 0 times or once around every point of the plane. Not if some
  /// edges were left out.
  bool winds_once = true;
  std::uint64_t tests = 0;  ///< orientation tests: at most 10 n + 3 n log2(n)
};

/// Sweeps over all edges, or only over those for which `is_swept` is not 0. `order` is that of
/// in_sweep_order(). `right_of`, if not null, is set to how often the loops wind around the points
/// just right of each edge; only if nothing crosses. O(n log n).
SweepResult sweep(const EdgeLoops& loops, std::span<const std::uint32_t> order,
                  std::span<const char> is_swept = {},
                  std::vector<std::int32_t>* right_of = nullptr);

/// By ring, the number of the smallest ring around it, or kNoRing. Each ring has 3 different points
/// at least. None if edges cross, or rings that touch pass into each other there. O(n log n).
inline constexpr std::uint32_t kNoRing = 0xffffffff;
std::optional<std::vector<std::uint32_t>> rings_around(const std::vector<Ring>& rings);

/// Proves that no two edges cross by segments_cross(). Refused as "`what` cross near lattice
/// point (x, y)": the start of the first edge, by its least x and then its two ends, that crosses
/// one before it in this order. O(n log n); O(n log^2 n) if it is refused.
Result<void> check_no_crossing(const EdgeLoops& loops, std::span<const std::uint32_t> order,
                               const SweepResult& swept, const char* what);

}  // namespace trocar
