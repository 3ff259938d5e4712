// SPDX-License-Identifier: GPL-3.0-or-later
// A grid that finds pairs of segments that may be near each other. Each cell lists the segments
// that pass through it.
// Tests: tests/pipeline/contour/simplification_test.cpp
#pragma once

#include <algorithm>
#include <cstdint>
#include <span>
#include <vector>

#include "formats/geometry/lattice.h"
#include "formats/geometry/lattice_box.h"
#include "formats/geometry/lattice_cells.h"

namespace trocar::pipeline {

struct LatticeSegment {
  LatticePoint a, b;
};

/// The grid has about as many cells as there are segments. A segment across the whole grid passes
/// through about as many cells as a row and a column have together.
class SegmentGrid {
 public:
  /// Segments whose distance along each axis is at most `max_distance` lattice steps have a common
  /// cell.
  SegmentGrid(std::span<const LatticeSegment> segments, std::int32_t max_distance);

  /// Calls visit(i, j), i > j, once for each common cell of each pair of segments.
  template <typename Visit>
  void for_each_pair(const Visit& visit) const {
    for (std::size_t cell = 0; cell + 1 < first_.size(); ++cell) {
      for (std::size_t i = first_[cell]; i < first_[cell + 1]; ++i) {
        for (std::size_t j = first_[cell]; j < i; ++j)
          visit(numbers_[i], numbers_[j]);
      }
    }
  }

  /// Calls visit(i), perhaps repeatedly, at least for the segments within `max_distance` of the box
  /// along each axis.
  template <typename Visit>
  void for_each_near(const LatticeBox& box, const Visit& visit) const {
    const auto cell = [this](std::int64_t at, std::int64_t count) {
      return std::clamp(static_cast<std::int64_t>(static_cast<double>(at) / cells_.size),
                        std::int64_t{0}, count - 1);
    };
    const std::int64_t columns = cells_.columns, rows = cells_.rows;
    const std::int64_t left = cell(std::int64_t{box.low.x} - cells_.low.x, columns),
                       right = cell(std::int64_t{box.high.x} - cells_.low.x, columns),
                       top = cell(std::int64_t{box.high.y} - cells_.low.y, rows);
    for (std::int64_t y = cell(std::int64_t{box.low.y} - cells_.low.y, rows); y <= top; ++y) {
      const auto row = static_cast<std::size_t>(y * columns);
      for (std::size_t at = first_[row + static_cast<std::size_t>(left)];
           at < first_[row + static_cast<std::size_t>(right) + 1]; ++at)
        visit(numbers_[at]);
    }
  }

 private:
  template <typename Visit>
  void for_each_cell(const LatticeSegment& segment, const Visit& visit) const;

  double max_distance_;
  LatticeCells cells_;
  std::vector<std::size_t> first_;      // by cell: its first entry in numbers_; then the end
  std::vector<std::uint32_t> numbers_;  // segment numbers, ascending in each cell
};

}  // namespace trocar::pipeline
