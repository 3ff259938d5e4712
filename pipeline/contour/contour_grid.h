// SPDX-License-Identifier: GPL-3.0-or-later
// A grid that finds the contour edges that may be near a point. Each cell lists the edges whose
// bounding boxes intersect the cell. The grid is built once.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "formats/geometry/lattice_box.h"
#include "formats/geometry/lattice_cells.h"

namespace trocar::pipeline {

class ContourGrid {
 public:
  /// An entry in the list of a cell: the consecutive edges `first` to `last` of one ring.
  /// `next_in_cell` is the index of the cell's next run, or kNone.
  struct Run {
    std::uint32_t first, last, next_in_cell;
  };

  /// Makes an empty grid over the box. `edges` is the number of edges that will be added; the grid
  /// has about as many cells.
  ContourGrid(const LatticeBox& box, std::size_t edges) : cells_(box, static_cast<double>(edges)) {
    heads_.assign(cells_.count(), kNone);
    runs_.reserve(edges);
  }

  /// Adds an edge. Precondition: the edges of a ring are added in the ring's order and have
  /// consecutive numbers from `first_of_ring` on. At least one number between the numbers of two
  /// rings is unused.
  void add(std::uint32_t edge, LatticePoint from, LatticePoint to, std::uint32_t first_of_ring) {
    any_cell(box_around(from, to), [&](std::uint32_t& head) {
      if (head != kNone && runs_[head].first >= first_of_ring && runs_[head].last + 1 >= edge) {
        runs_[head].last = edge;
      } else {
        runs_.push_back({edge, edge, head});
        head = static_cast<std::uint32_t>(runs_.size() - 1);
      }
      return false;
    });
  }

  /// Returns true if is_wanted(run) holds for a run of a cell that the box intersects.
  template <typename Wanted>
  bool any_near(const LatticeBox& box, const Wanted& is_wanted) {
    return any_cell(box, [&](std::uint32_t head) {
      for (; head != kNone; head = runs_[head].next_in_cell)
        if (is_wanted(runs_[head])) return true;
      return false;
    });
  }

 private:
  static constexpr std::uint32_t kNone = 0xffffffff;

  // Calls visit(head) for the cells that intersect the box, until visit() returns true. Returns
  // whether visit() returned true. Points outside the grid belong to its outermost cells.
  template <typename Visit>
  bool any_cell(const LatticeBox& box, const Visit& visit) {
    const auto cell = [this](std::int32_t at, std::int32_t low, std::int32_t count) {
      const double c = (static_cast<double>(at) - low) / cells_.size;
      return static_cast<std::int32_t>(std::clamp(c, 0.0, static_cast<double>(count - 1)));
    };
    const std::int32_t x0 = cell(box.low.x, cells_.low.x, cells_.columns),
                       x1 = cell(box.high.x, cells_.low.x, cells_.columns);
    const std::int32_t y0 = cell(box.low.y, cells_.low.y, cells_.rows),
                       y1 = cell(box.high.y, cells_.low.y, cells_.rows);
    for (std::int32_t y = y0; y <= y1; ++y) {
      for (std::int32_t x = x0; x <= x1; ++x)
        if (visit(heads_[static_cast<std::size_t>(y) * static_cast<std::size_t>(cells_.columns) +
                         static_cast<std::size_t>(x)]))
          return true;
    }
    return false;
  }

  LatticeCells cells_;
  std::vector<std::uint32_t> heads_;  // for each cell: the index of its first run, or kNone
  std::vector<Run> runs_;
};

}  // namespace trocar::pipeline
