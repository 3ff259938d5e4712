// SPDX-License-Identifier: Apache-2.0
#include "formats/mesh/segment_grid.h"

namespace trocar {

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

std::vector<LatticeSegment> edges_of(const Pslg& outline, const std::vector<bool>& is_open) {
  std::vector<LatticeSegment> out;
  for (std::size_t r = 0; r < outline.rings.size(); ++r) {
    const Ring& ring = outline.rings[r];
    for (std::size_t k = 0; k + 1 < ring.size(); ++k)
      out.push_back({ring[k], ring[k + 1]});
    const bool open = !is_open.empty() && is_open[r];
    out.push_back({ring.back(), open ? ring.back() : ring[0]});
  }
  return out;
}

bool has_tight_spots(const std::vector<LatticeSegment>& edges, double clearance) {
  bool any = false;
  for_tight_spots(edges, SegmentGrid(edges, margin_of(clearance)), clearance,
                  [&any](std::uint32_t, std::uint32_t) { any = true; });
  return any;
}

}  // namespace trocar
