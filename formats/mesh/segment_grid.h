// SPDX-License-Identifier: Apache-2.0
// Distances between points and segments in floating point, in the unit of the coordinates.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <span>
#include <tuple>
#include <utility>
#include <vector>

#include "formats/mesh/lattice.h"
#include "formats/mesh/slice_mesh.h"

namespace trocar {

struct Point {
  double x = 0, y = 0;
};

inline Point point(LatticePoint p) {
  return {static_cast<double>(p.x), static_cast<double>(p.y)};
}

inline double distance2_between(Point a, Point b) {
  return (a.x - b.x) * (a.x - b.x) + (a.y - b.y) * (a.y - b.y);
}

/// Finds the point of the segment ab that is nearest to p. Returns it as a fraction of the way from
/// a to b.
inline double fraction_along(Point a, Point b, Point p) {
  const double abx = b.x - a.x, aby = b.y - a.y;
  const double length2 = abx * abx + aby * aby;
  if (length2 == 0) return 0;
  return std::clamp(((p.x - a.x) * abx + (p.y - a.y) * aby) / length2, 0.0, 1.0);
}

/// Squared distance from p to the segment ab. It is exactly zero if a, b and p are lattice points
/// and p lies on the segment.
inline double segment_distance2(Point a, Point b, Point p) {
  const double abx = b.x - a.x, aby = b.y - a.y, apx = p.x - a.x, apy = p.y - a.y;
  const double length2 = abx * abx + aby * aby, along = apx * abx + apy * aby;
  if (along <= 0 || length2 == 0) return apx * apx + apy * apy;
  if (along >= length2) return distance2_between(b, p);
  const double cross = abx * apy - aby * apx;
  return cross * cross / length2;
}

// A grid that finds pairs of segments that may be near each other. Each cell lists the segments
// that pass through it.

struct LatticeSegment {
  LatticePoint a, b;
};

/// Memory: the grid has at most four times as many cells as there are segments. Time: a segment
/// across the whole grid passes through about as many cells as a row and a column have together.
class SegmentGrid {
 public:
  /// If a point of one segment and a point of another differ by at most `max_distance` lattice
  /// steps in x and in y, the two segments have a common cell.
  SegmentGrid(std::span<const LatticeSegment> segments, std::int32_t max_distance);

  /// Calls visit(i, j), with i > j, for each pair of segments that have a common cell: once for
  /// each cell that they have in common.
  template <typename Visit>
  void for_each_pair(const Visit& visit) const {
    for (const std::uint32_t newest : newest_) {
      for (std::uint32_t i = newest; i != kNone; i = entries_[i].older) {
        for (std::uint32_t j = entries_[i].older; j != kNone; j = entries_[j].older)
          visit(entries_[i].segment, entries_[j].segment);
      }
    }
  }

  /// Calls visit(j) for each segment j in each cell of `segment`, including `segment` itself. If
  /// segment j has several cells in common with `segment`, it is visited several times.
  /// Precondition: `segment` is in the grid.
  template <typename Visit>
  void for_each_near(const LatticeSegment& segment, const Visit& visit) const {
    for_each_cell(segment, [&](std::size_t cell) {
      for (std::uint32_t i = newest_[cell]; i != kNone; i = entries_[i].older)
        visit(entries_[i].segment);
    });
  }

  /// Calls visit(j) for every segment j that comes within the constructor's `max_distance` of the
  /// box along both axes, and possibly for others. A segment may be visited several times.
  template <typename Visit>
  void for_each_near(const LatticeBox& box, const Visit& visit) const {
    if (newest_.empty()) return;
    const auto cell = [this](std::int64_t at, std::int64_t count) {
      return std::clamp(at >> shift_, std::int64_t{0}, count - 1);
    };
    const auto rows = static_cast<std::int64_t>(newest_.size()) / columns_;
    const std::int64_t left = cell(std::int64_t{box.low.x} - low_.x - margin_, columns_),
                       right = cell(std::int64_t{box.high.x} - low_.x + margin_, columns_),
                       top = cell(std::int64_t{box.high.y} - low_.y + margin_, rows);
    for (std::int64_t y = cell(std::int64_t{box.low.y} - low_.y - margin_, rows); y <= top; ++y) {
      for (std::int64_t x = left; x <= right; ++x) {
        for (std::uint32_t i = newest_[static_cast<std::size_t>(y * columns_ + x)]; i != kNone;
             i = entries_[i].older)
          visit(entries_[i].segment);
      }
    }
  }

 private:
  static constexpr std::uint32_t kNone = 0xffffffff;
  struct Entry {
    std::uint32_t segment, older;  // older: the next entry of the same cell, or kNone
  };

  // Widens the segment by margin_ (half of `max_distance`, and one step for rounding). Calls
  // visit(cell) for the cells that the wider segment passes through, row by row.
  template <typename Visit>
  void for_each_cell(const LatticeSegment& segment, const Visit& visit) const {
    const auto [a, b] = segment;
    const auto cell = [this](std::int64_t at) { return at >> shift_; };
    const std::int64_t ax = std::int64_t{a.x} - low_.x, ay = std::int64_t{a.y} - low_.y,
                       bx = std::int64_t{b.x} - low_.x, by = std::int64_t{b.y} - low_.y;
    const std::int64_t first = cell(std::min(ay, by) - margin_),
                       last = cell(std::max(ay, by) + margin_);
    std::int64_t from = cell(std::min(ax, bx) - margin_), to = cell(std::max(ax, bx) + margin_);
    const bool is_steep_or_flat = ay == by || last - first < 2 || to - from < 2;
    for (std::int64_t row = first; row <= last; ++row) {
      if (!is_steep_or_flat) [[unlikely]]
        std::tie(from, to) = cells_in_row(segment, row);
      for (std::int64_t x = from; x <= to; ++x)
        visit(static_cast<std::size_t>(row * columns_ + x));
    }
  }
  std::pair<std::int64_t, std::int64_t> cells_in_row(const LatticeSegment& segment,
                                                     std::int64_t row) const;

  std::int64_t margin_ = 0, columns_ = 1;
  int shift_ = 0;                      // the cells are squares of 2^shift_ lattice steps
  LatticePoint low_;                   // the lower left corner of the grid
  std::vector<std::uint32_t> newest_;  // for each cell: index of its newest entry, or kNone
  std::vector<Entry> entries_;
};

// The tight spots of an outline: edges shorter than a clearance, and pairs of edges without a
// common end that are nearer to each other than the clearance. Precondition of all functions: edges
// do not cross. Distances are in lattice steps.

/// The clearance, rounded up to whole lattice steps.
inline std::int32_t margin_of(double clearance) {
  return static_cast<std::int32_t>(std::ceil(clearance));
}

inline LatticeBox widened(LatticeBox box, std::int32_t margin) {
  return {{box.low.x - margin, box.low.y - margin}, {box.high.x + margin, box.high.y + margin}};
}

inline bool is_short(const LatticeSegment& s, double clearance) {
  return static_cast<double>(distance2(s.a, s.b)) < clearance * clearance;
}

/// Returns true if the edges have no common end and are nearer to each other than the clearance.
inline bool is_tight(const LatticeSegment& s, const LatticeSegment& t, double clearance) {
  if (s.a == t.a || s.a == t.b || s.b == t.a || s.b == t.b ||
      apart(widened(box_around(s.a, s.b), margin_of(clearance)), box_around(t.a, t.b)))
    return false;
  const Point a = point(s.a), b = point(s.b), c = point(t.a), d = point(t.b);
  return std::min({segment_distance2(a, b, c), segment_distance2(a, b, d),
                   segment_distance2(c, d, a), segment_distance2(c, d, b)}) < clearance * clearance;
}

/// The edges of an outline, ring by ring: one for each vertex, to the next vertex. If is_open[r] is
/// true, ring r is a line, and the edge of its last vertex has length 0. If there are no lines,
/// `is_open` may be empty.
std::vector<LatticeSegment> edges_of(const Pslg& outline, const std::vector<bool>& is_open);

/// Calls visit(i, j) for each tight spot, where i and j are indices of edges. For a short edge
/// i = j. For a pair of edges, visit(i, j) may be called repeatedly. Precondition: `grid` was made
/// of `edges` with margin_of(clearance).
template <typename Visit>
void for_tight_spots(const std::vector<LatticeSegment>& edges, const SegmentGrid& grid,
                     double clearance, const Visit& visit) {
  for (std::uint32_t i = 0; i < edges.size(); ++i)
    if (edges[i].a != edges[i].b && is_short(edges[i], clearance)) visit(i, i);
  grid.for_each_pair([&](std::uint32_t i, std::uint32_t j) {
    if (is_tight(edges[i], edges[j], clearance)) visit(i, j);
  });
}

/// Returns true if there is a tight spot. O(n log n) typically.
bool has_tight_spots(const std::vector<LatticeSegment>& edges, double clearance);

}  // namespace trocar
