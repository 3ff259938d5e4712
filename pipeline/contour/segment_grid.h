// SPDX-License-Identifier: GPL-3.0-or-later
// Segments by the cells of a grid that they pass through: which may be near each other?
#pragma once

#include <algorithm>
#include <cstdint>
#include <span>
#include <vector>

#include "formats/geometry/lattice.h"
#include "formats/geometry/lattice_cells.h"

namespace trocar::pipeline {

struct LatticeSegment {
  LatticePoint a, b;
};

/// One cell for each segment. A segment as long as all of them together are wide passes through
/// about as many cells as a row and a column have.
class SegmentGrid {
 public:
  /// Segments whose distance along each axis is at most `reach`, in steps, have a cell in common.
  SegmentGrid(std::span<const LatticeSegment> segments, std::int32_t reach);

  /// Calls visit(i, j), i > j, for all pairs with a common cell, once for each of these.
  template <typename Visit>
  void for_each_pair(const Visit& visit) const {
    for (std::size_t cell = 0; cell + 1 < first_.size(); ++cell) {
      for (std::size_t i = first_[cell]; i < first_[cell + 1]; ++i) {
        for (std::size_t j = first_[cell]; j < i; ++j)
          visit(numbers_[i], numbers_[j]);
      }
    }
  }

 private:
  template <typename Visit>
  void for_each_cell(const LatticeSegment& segment, const Visit& visit) const;

  double reach_;
  LatticeCells cells_;
  std::vector<std::size_t> first_;      // in numbers_, by cell; and the end
  std::vector<std::uint32_t> numbers_;  // of segments, ascending in each cell
};

}  // namespace trocar::pipeline
