// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/contour/segment_grid.h"

#include <cmath>

#include "formats/geometry/lattice_cells.h"

namespace trocar::pipeline {

SegmentGrid::SegmentGrid(std::span<const LatticeSegment> segments, std::int32_t max_distance)
    // A point in the middle between two segments is within half the distance of both. One more step
    // is for rounding.
    : margin_((max_distance + 1) / 2 + 1) {
  if (segments.empty()) return;
  LatticeBox box = box_around(segments[0].a, segments[0].b);
  for (const LatticeSegment& s : segments) {
    widen(box, s.a);
    widen(box, s.b);
  }
  const LatticeCells cells(box, static_cast<double>(segments.size()));
  shift_ = std::ilogb(cells.size);
  const auto count = [&](std::int32_t low, std::int32_t high) {
    return ((std::int64_t{high} - low + 2 * margin_) >> shift_) + 1;
  };
  low_ = {static_cast<std::int32_t>(box.low.x - margin_),
          static_cast<std::int32_t>(box.low.y - margin_)};
  columns_ = count(box.low.x, box.high.x);
  newest_.assign(static_cast<std::size_t>(columns_ * count(box.low.y, box.high.y)), kNone);
  entries_.reserve(4 * segments.size());
  for (std::uint32_t k = 0; k < segments.size(); ++k) {
    for_each_cell(segments[k], [&](std::size_t cell) {
      entries_.push_back({k, newest_[cell]});
      newest_[cell] = static_cast<std::uint32_t>(entries_.size() - 1);
    });
  }
}

std::pair<std::int64_t, std::int64_t> SegmentGrid::cells_in_row(const LatticeSegment& segment,
                                                                std::int64_t row) const {
  const auto relative = [this](LatticePoint p) {
    return std::pair{static_cast<double>(p.x) - low_.x, static_cast<double>(p.y) - low_.y};
  };
  const auto [ax, ay] = relative(segment.a);
  const auto [bx, by] = relative(segment.b);
  const double per_y = (bx - ax) / (by - ay);
  const auto x_at = [&, ax = ax, ay = ay, by = by](std::int64_t y) {
    return ax +
           per_y * (std::clamp(static_cast<double>(y), std::min(ay, by), std::max(ay, by)) - ay);
  };
  const double from = x_at((row << shift_) - margin_), to = x_at(((row + 1) << shift_) + margin_);
  const auto cell = [this](double at) { return static_cast<std::int64_t>(at) >> shift_; };
  return {cell(std::min(from, to) - static_cast<double>(margin_)),
          cell(std::max(from, to) + static_cast<double>(margin_))};
}

}  // namespace trocar::pipeline
