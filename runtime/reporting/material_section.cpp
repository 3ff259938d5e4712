// SPDX-License-Identifier: Apache-2.0
#include "runtime/reporting/material_section.h"

#include <algorithm>
#include <cstddef>
#include <limits>

namespace trocar::runtime {

std::vector<std::array<double, 2>> material_along(const Sheet& sheet, int axis, double at_m) {
  std::vector<std::array<double, 2>> intervals;
  const auto u = static_cast<Eigen::Index>(axis), v = 1 - u;
  for (const Triangle& triangle : sheet.mesh.triangles) {
    if (triangle == kFreeSlot) continue;
    std::array<Eigen::Vector2d, 3> corner;
    for (std::size_t k = 0; k < 3; ++k) {
      const LatticePoint p = sheet.mesh.vertices[triangle[k]];
      corner[k] = sheet.transform.to_scene(
          Eigen::Vector2d(static_cast<double>(p.x), static_cast<double>(p.y)));
    }
    double low_m = std::numeric_limits<double>::infinity(), high_m = -low_m;
    for (std::size_t k = 0; k < 3; ++k) {
      const Eigen::Vector2d &a = corner[k], &b = corner[(k + 1) % 3];
      if ((a[v] > at_m) == (b[v] > at_m)) continue;
      const double crossing_m = a[u] + (at_m - a[v]) / (b[v] - a[v]) * (b[u] - a[u]);
      low_m = std::min(low_m, crossing_m);
      high_m = std::max(high_m, crossing_m);
    }
    if (low_m < high_m) intervals.push_back({low_m, high_m});
  }
  std::sort(intervals.begin(), intervals.end());
  constexpr double kJoined_m = 1e-5;
  std::vector<std::array<double, 2>> joined;
  for (const std::array<double, 2>& interval : intervals) {
    if (!joined.empty() && interval[0] <= joined.back()[1] + kJoined_m)
      joined.back()[1] = std::max(joined.back()[1], interval[1]);
    else
      joined.push_back(interval);
  }
  return joined;
}

}  // namespace trocar::runtime
