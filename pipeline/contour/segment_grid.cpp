// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/contour/segment_grid.h"

#include <utility>

#include "formats/geometry/lattice_box.h"
#include "pipeline/contour/segment_distance.h"

namespace trocar::pipeline {

// Visits, in each row, the cells between the segment's entry and exit, widened by the search
// distance and by one lattice step for rounding.
template <typename Visit>
void SegmentGrid::for_each_cell(const LatticeSegment& segment, const Visit& visit) const {
  const std::int64_t columns = cells_.columns, rows = cells_.rows;
  const auto cell = [this](double at, std::int64_t count) {
    return std::clamp(static_cast<std::int64_t>(at / cells_.size), std::int64_t{0}, count - 1);
  };
  const auto relative = [this](LatticePoint p) {
    return Point{static_cast<double>(p.x) - cells_.low.x, static_cast<double>(p.y) - cells_.low.y};
  };
  Point a = relative(segment.a), b = relative(segment.b);
  if (a.y > b.y) std::swap(a, b);
  const double margin = max_distance_ + 1;
  const std::int64_t first = cell(a.y - margin, rows), last = cell(b.y + margin, rows);
  if (first == last) {
    const std::int64_t end = cell(std::max(a.x, b.x) + margin, columns);
    for (std::int64_t x = cell(std::min(a.x, b.x) - margin, columns); x <= end; ++x)
      visit(static_cast<std::size_t>(first * columns + x));
    return;
  }
  for (std::int64_t row = first; row <= last; ++row) {
    const auto x_at = [&](double y) {
      return a.x + (b.x - a.x) * std::clamp((y - a.y) / (b.y - a.y), 0.0, 1.0);
    };
    double from = a.x, to = b.x;
    if (a.y != b.y) {
      from = x_at(static_cast<double>(row) * cells_.size - margin);
      to = x_at(static_cast<double>(row + 1) * cells_.size + margin);
    }
    if (from > to) std::swap(from, to);
    const std::int64_t end = cell(to + margin, columns);
    for (std::int64_t x = cell(from - margin, columns); x <= end; ++x)
      visit(static_cast<std::size_t>(row * columns + x));
  }
}

SegmentGrid::SegmentGrid(std::span<const LatticeSegment> segments, std::int32_t max_distance)
    : max_distance_(max_distance) {
  if (segments.empty()) return;
  LatticeBox box = box_around(segments[0].a, segments[0].b);
  for (const LatticeSegment& s : segments) {
    widen(box, s.a);
    widen(box, s.b);
  }
  cells_ = LatticeCells(box, static_cast<double>(segments.size()));
  first_.assign(cells_.count() + 1, 0);
  for (const LatticeSegment& s : segments)
    for_each_cell(s, [this](std::size_t cell) { ++first_[cell + 1]; });
  for (std::size_t i = 1; i < first_.size(); ++i)
    first_[i] += first_[i - 1];
  numbers_.resize(first_.back());
  std::vector<std::size_t> next(first_.begin(), first_.end() - 1);
  for (std::uint32_t k = 0; k < segments.size(); ++k)
    for_each_cell(segments[k], [&](std::size_t cell) { numbers_[next[cell]++] = k; });
}

}  // namespace trocar::pipeline
