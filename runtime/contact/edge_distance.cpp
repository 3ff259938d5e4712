// SPDX-License-Identifier: Apache-2.0
#include "runtime/contact/edge_distance.h"

#include <algorithm>
#include <cmath>

#include "formats/geometry/lattice_box.h"

namespace trocar::runtime {
namespace {

using Eigen::Vector2d;

/// The nodes of a raster.
struct Raster {
  double left_mm, bottom_mm, spacing_mm;
  int columns, rows;

  /// First node at or behind a coordinate, and last node at or before it, within the raster.
  static int first(double mm, double from_mm, double spacing_mm) {
    return std::max(0, static_cast<int>(std::ceil((mm - from_mm) / spacing_mm)));
  }
  static int last(double mm, double from_mm, double spacing_mm, int count) {
    return std::min(count - 1, static_cast<int>(std::floor((mm - from_mm) / spacing_mm)));
  }
  std::size_t index(int column, int row) const {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(columns) +
           static_cast<std::size_t>(column);
  }
  Vector2d node(int column, int row) const {
    return {left_mm + column * spacing_mm, bottom_mm + row * spacing_mm};
  }
};

/// Lowers the squared distances of the nodes within the reach of an edge.
void approach(const Raster& raster, const Vector2d& a, const Vector2d& b,
              std::vector<float>& squared_mm2) {
  constexpr double kReach_mm = EdgeDistance::kReach_mm;
  const Vector2d ab = b - a, low = a.cwiseMin(b).array() - kReach_mm,
                 high = a.cwiseMax(b).array() + kReach_mm;
  const double per_length2 = 1 / ab.squaredNorm(), h = raster.spacing_mm;
  const int right = Raster::last(high.x(), raster.left_mm, h, raster.columns),
            top = Raster::last(high.y(), raster.bottom_mm, h, raster.rows);
  for (int r = Raster::first(low.y(), raster.bottom_mm, h); r <= top; ++r) {
    for (int c = Raster::first(low.x(), raster.left_mm, h); c <= right; ++c) {
      const Vector2d p = raster.node(c, r) - a;
      const double part = std::clamp(p.dot(ab) * per_length2, 0.0, 1.0);
      float& squared = squared_mm2[raster.index(c, r)];
      squared = std::min(squared, static_cast<float>((p - part * ab).squaredNorm()));
    }
  }
}

/// Notes in each row where an edge crosses the line through its nodes.
void cross_rows(const Raster& raster, Vector2d a, Vector2d b,
                std::vector<std::vector<double>>& crossings_mm) {
  if (a.y() > b.y()) std::swap(a, b);
  const double h = raster.spacing_mm;
  for (int r = Raster::first(a.y(), raster.bottom_mm, h); r < raster.rows; ++r) {
    const double y_mm = raster.bottom_mm + r * h;
    if (!(y_mm < b.y())) break;
    const double part = (y_mm - a.y()) / (b.y() - a.y());
    crossings_mm[static_cast<std::size_t>(r)].push_back(a.x() + part * (b.x() - a.x()));
  }
}

}  // namespace

EdgeDistance::EdgeDistance(const Pslg& outline, const Lattice& lattice) {
  std::vector<LatticePoint> corners;
  for (const Ring& ring : outline.rings)
    corners.insert(corners.end(), ring.begin(), ring.end());
  if (corners.empty()) return;
  const LatticeBox box = box_around(corners);
  const double step_mm = lattice.step_mm();
  const double width_mm = static_cast<double>(std::int64_t{box.high.x} - box.low.x) * step_mm +
                          2 * kReach_mm,
               height_mm = static_cast<double>(std::int64_t{box.high.y} - box.low.y) * step_mm +
                           2 * kReach_mm;
  spacing_mm_ = std::max(kSpacing_mm, std::sqrt(width_mm * height_mm / kMaxNodes));
  left_mm_ = box.low.x * step_mm - kReach_mm;
  bottom_mm_ = box.low.y * step_mm - kReach_mm;
  columns_ = static_cast<int>(width_mm / spacing_mm_) + 2;
  rows_ = static_cast<int>(height_mm / spacing_mm_) + 2;
  const Raster raster{left_mm_, bottom_mm_, spacing_mm_, columns_, rows_};
  distance_mm_.assign(raster.index(0, rows_), static_cast<float>(kReach_mm * kReach_mm));
  std::vector<std::vector<double>> crossings_mm(static_cast<std::size_t>(rows_));
  for (const Ring& ring : outline.rings) {
    for (std::size_t i = 0; i < ring.size(); ++i) {
      const LatticePoint from = ring[i], to = ring[(i + 1) % ring.size()];
      const Vector2d a = Vector2d(from.x, from.y) * step_mm, b = Vector2d(to.x, to.y) * step_mm;
      approach(raster, a, b, distance_mm_);
      cross_rows(raster, a, b, crossings_mm);
    }
  }
  for (int r = 0; r < rows_; ++r) {
    std::vector<double>& crossed_mm = crossings_mm[static_cast<std::size_t>(r)];
    std::sort(crossed_mm.begin(), crossed_mm.end());
    std::size_t passed = 0;
    for (int c = 0; c < columns_; ++c) {
      while (passed < crossed_mm.size() && crossed_mm[passed] <= raster.node(c, r).x())
        ++passed;
      float& distance = distance_mm_[raster.index(c, r)];
      distance = std::copysign(std::sqrt(distance), passed % 2 == 1 ? 1.0F : -1.0F);
    }
  }
}

EdgeDistance::Sample EdgeDistance::at(const PlanarTransform& transform,
                                      const Vector2d& at_m) const noexcept {
  const Vector2d at_mm = transform.to_lattice(at_m) * transform.lattice.step_mm();
  const double x = (at_mm.x() - left_mm_) / spacing_mm_, y = (at_mm.y() - bottom_mm_) / spacing_mm_;
  Sample out;
  if (!(x >= 0 && y >= 0 && x < columns_ - 1 && y < rows_ - 1)) return out;
  const int c = static_cast<int>(x), r = static_cast<int>(y);
  const auto* low = distance_mm_.data() + static_cast<std::ptrdiff_t>(r) * columns_ + c;
  const auto* high = low + columns_;
  const double u = x - c, v = y - r;
  const double bottom = low[0] + u * (low[1] - low[0]), top = high[0] + u * (high[1] - high[0]);
  out.distance_m = 1e-3 * (bottom + v * (top - bottom));
  const double by_x = ((1 - v) * (low[1] - low[0]) + v * (high[1] - high[0])) / spacing_mm_,
               by_y = (top - bottom) / spacing_mm_;
  out.gradient = {transform.cosine * by_x - transform.sine * by_y,
                  transform.sine * by_x + transform.cosine * by_y};
  return out;
}

}  // namespace trocar::runtime
