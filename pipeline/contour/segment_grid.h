// SPDX-License-Identifier: GPL-3.0-or-later
// A grid that finds pairs of segments that may be near each other. Each cell lists the segments
// that pass through it.
#pragma once

#include <algorithm>
#include <cstdint>
#include <span>
#include <tuple>
#include <utility>
#include <vector>

#include "formats/geometry/lattice.h"
#include "formats/geometry/lattice_box.h"

namespace trocar::pipeline {

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

}  // namespace trocar::pipeline
