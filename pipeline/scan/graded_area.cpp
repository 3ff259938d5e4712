// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/scan/graded_area.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace trocar::pipeline {
namespace {

constexpr double kGrowth = 0.5;  // growth of the edge length per distance
constexpr double kAreaOfEdge2 = std::numbers::sqrt3 / 4;

}  // namespace

GradedArea::GradedArea(const Image& hu, const PixelGrid& grid, double hu_per_edge)
    : grid_(grid),
      width_(hu.width),
      height_(hu.height),
      min_mm2_(kMinArea_px2 * grid.spacing_u_mm * grid.spacing_v_mm),
      edge_mm_(hu.values.size()) {
  const double u = grid.spacing_u_mm, v = grid.spacing_v_mm;
  const auto value = [&hu](int x, int y) {
    return static_cast<double>(
        hu.at(std::clamp(x, 0, hu.width - 1), std::clamp(y, 0, hu.height - 1)));
  };
  const auto edge = [&](int x, int y) -> float& {
    return edge_mm_[static_cast<std::size_t>(y) * width_ + x];
  };
  const double min_edge = std::sqrt(min_mm2_ / kAreaOfEdge2);
  for (int y = 0; y < height_; ++y) {
    for (int x = 0; x < width_; ++x) {
      double du = 0, dv = 0;
      for (const int k : {-1, 0, 1}) {
        const double weight = k == 0 ? 2 : 1;
        du += weight * (value(x + 1, y + k) - value(x - 1, y + k));
        dv += weight * (value(x + k, y + 1) - value(x + k, y - 1));
      }
      const double hu_per_mm = std::hypot(du / u, dv / v) / 8;
      edge(x, y) =
          static_cast<float>(std::clamp(hu_per_edge / std::max(hu_per_mm, 1e-9), min_edge, 1e6));
    }
  }
  // In two sweeps over the image, each pixel's edge length is limited according to four of its
  // neighbours.
  const auto limit = [&](int x, int y, int dx, int dy) {
    if (x + dx < 0 || x + dx >= width_ || y + dy < 0 || y + dy >= height_) return;
    const auto max_edge =
        static_cast<float>(edge(x + dx, y + dy) + kGrowth * std::hypot(dx * u, dy * v));
    edge(x, y) = std::min(edge(x, y), max_edge);
  };
  for (int y = 0; y < height_; ++y) {
    for (int x = 0; x < width_; ++x) {
      limit(x, y, -1, 0), limit(x, y, 0, -1), limit(x, y, -1, -1), limit(x, y, 1, -1);
    }
    for (int x = width_ - 1; x >= 0; --x)
      limit(x, y, 1, 0);
  }
  for (int y = height_ - 1; y >= 0; --y) {
    for (int x = width_ - 1; x >= 0; --x) {
      limit(x, y, 1, 0), limit(x, y, 0, 1), limit(x, y, 1, 1), limit(x, y, -1, 1);
    }
    for (int x = 0; x < width_; ++x)
      limit(x, y, -1, 0);
  }
}

double GradedArea::mm2_at(LatticePoint p) const {
  const auto index = [&](std::int32_t c, double spacing_mm, int offset, int count) {
    const double i = std::rint(grid_.lattice.to_mm(c) / spacing_mm) - offset;
    return static_cast<std::size_t>(std::clamp(i, 0.0, count - 1.0));
  };
  const double edge = edge_mm_[index(p.y, grid_.spacing_v_mm, grid_.offset_y, height_) * width_ +
                               index(p.x, grid_.spacing_u_mm, grid_.offset_x, width_)];
  return std::max(min_mm2_, kAreaOfEdge2 * edge * edge);
}

}  // namespace trocar::pipeline
