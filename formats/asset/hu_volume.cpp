// SPDX-License-Identifier: Apache-2.0
#include "formats/asset/hu_volume.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

namespace trocar {
namespace {

constexpr float kNoHu = std::numeric_limits<float>::quiet_NaN();

std::array<Eigen::Vector2d, 19> make_points() {
  std::array<Eigen::Vector2d, 19> points;
  points[0].setZero();
  std::size_t n = 1;
  for (int ring = 1; ring <= 2; ++ring) {
    const int count = 6 * ring;
    const double inner = 3.0 * ring * (ring - 1) + 1, outer = inner + count;
    const double radius =
        2.0 / 3 * (std::pow(outer, 1.5) - std::pow(inner, 1.5)) / (outer - inner) / std::sqrt(19.0);
    for (int k = 0; k < count; ++k) {
      const double angle = 2 * std::numbers::pi * k / count;
      points[n++] = radius * Eigen::Vector2d(std::cos(angle), std::sin(angle));
    }
  }
  return points;
}

}  // namespace

const std::array<Eigen::Vector2d, 19>& disc_points() noexcept {
  static const std::array<Eigen::Vector2d, 19> points = make_points();
  return points;
}

float HuPlane::at(double x_mm, double y_mm) const noexcept {
  const double x = (x_mm - origin_mm.x()) / pitch_mm.x(), y = (y_mm - origin_mm.y()) / pitch_mm.y();
  if (!(x > -1 && y > -1 && x < columns && y < rows)) return kNoHu;
  const double left = std::floor(x), below = std::floor(y), fx = x - left, fy = y - below;
  const int column = static_cast<int>(left), row = static_cast<int>(below);
  double sum = 0, weights = 0;
  for (int dy = 0; dy < 2; ++dy) {
    for (int dx = 0; dx < 2; ++dx) {
      const int c = column + dx, r = row + dy;
      if (c < 0 || r < 0 || c >= columns || r >= rows) continue;
      const float value = hu[static_cast<std::size_t>(r) * static_cast<std::size_t>(columns) +
                             static_cast<std::size_t>(c)];
      if (std::isnan(value)) continue;
      const double weight = (dx == 1 ? fx : 1 - fx) * (dy == 1 ? fy : 1 - fy);
      sum += weight * static_cast<double>(value);
      weights += weight;
    }
  }
  return weights > 0 ? static_cast<float>(sum / weights) : kNoHu;
}

float HuPlane::mean(double x_mm, double y_mm, double radius_mm) const noexcept {
  double sum = 0;
  int count = 0;
  for (const Eigen::Vector2d& p : disc_points()) {
    const float value = at(x_mm + radius_mm * p.x(), y_mm + radius_mm * p.y());
    if (std::isnan(value)) continue;
    sum += static_cast<double>(value);
    ++count;
  }
  return count > 0 ? static_cast<float>(sum / count) : kNoHu;
}

const HuPlane* HuVolume::find(int index) const noexcept {
  const auto found =
      std::lower_bound(planes.begin(), planes.end(), index,
                       [](const HuPlane& plane, int wanted) { return plane.index < wanted; });
  return found != planes.end() && found->index == index ? &*found : nullptr;
}

float HuVolume::at(const Eigen::Vector3d& p_lps_mm) const noexcept {
  if (planes.empty()) return kNoHu;
  // The position in a plane's own frame; z is its height above the plane.
  const auto in_plane = [&](const HuPlane& plane) -> Eigen::Vector3d {
    return plane.T_lps_plane.linear().transpose() * (p_lps_mm - plane.T_lps_plane.translation());
  };
  const bool ascends =
      planes.size() < 2 || in_plane(planes.front()).z() >= in_plane(planes.back()).z();
  const auto above = std::partition_point(planes.begin(), planes.end(), [&](const HuPlane& plane) {
    return (in_plane(plane).z() >= 0) == ascends;
  });
  const auto value = [&](const HuPlane& plane) {
    const Eigen::Vector3d at_plane = in_plane(plane);
    return plane.at(at_plane.x(), at_plane.y());
  };
  if (above == planes.begin()) return value(*above);
  if (above == planes.end()) return value(planes.back());
  const HuPlane &low = *(above - 1), &high = *above;
  const double to_low = std::abs(in_plane(low).z()), to_high = std::abs(in_plane(high).z());
  const float a = value(low), b = value(high);
  if (std::isnan(a) || to_low + to_high == 0) return b;
  if (std::isnan(b)) return a;
  return static_cast<float>((static_cast<double>(a) * to_high + static_cast<double>(b) * to_low) /
                            (to_low + to_high));
}

}  // namespace trocar
