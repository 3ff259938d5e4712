// SPDX-License-Identifier: Apache-2.0
#include "runtime/devices/tip_workspace.h"

#include <array>
#include <cmath>

#include "runtime/devices/pose_margins.h"

namespace trocar::runtime {
namespace {

constexpr double kStep_m = 2e-3;

bool is_reachable(const DeviceSpecification& device, const SafetyLimits& limits, const Tool& tool,
                  const Eigen::Quaterniond& q, const Eigen::Vector3d& tip_m) noexcept {
  const Pose T_device_plate{tip_m - q * tool.tip_plate_m, q};
  return pose_fault(limits, pose_margins(device, limits, tool, T_device_plate)) == Fault::kNone;
}

}  // namespace

std::optional<WorkspaceHeights> workspace_heights(const DeviceSpecification& device,
                                                  const SafetyLimits& limits, const Tool& tool,
                                                  const Eigen::Quaterniond& q) {
  std::optional<WorkspaceHeights> tallest;
  WorkspaceHeights now;
  bool within = false;
  const int steps = static_cast<int>(
      std::floor((limits.workspace_max_m[2] - limits.workspace_min_m[2]) / kStep_m + 1e-9));
  for (int i = 0; i <= steps; ++i) {
    Eigen::Vector3d tip_m = q * tool.tip_plate_m;
    tip_m.z() += limits.workspace_min_m[2] + i * kStep_m;
    const bool good = is_reachable(device, limits, tool, q, tip_m);
    if (good && !within) now.min_m = tip_m.z();
    within = good;
    if (!good) continue;
    now.max_m = tip_m.z();
    if (!tallest || now.max_m - now.min_m >= tallest->max_m - tallest->min_m) tallest = now;
  }
  return tallest;
}

std::optional<WorkspaceRectangle> workspace_rectangle(const DeviceSpecification& device,
                                                      const SafetyLimits& limits, const Tool& tool,
                                                      double tip_z_m, const Eigen::Quaterniond& q) {
  const Eigen::Vector2d middle_m = (q * tool.tip_plate_m).head<2>();
  const auto is_good = [&](double x_m, double y_m) {
    return is_reachable(device, limits, tool, q, {middle_m.x() + x_m, middle_m.y() + y_m, tip_z_m});
  };
  if (!is_good(0, 0)) return std::nullopt;
  // Positions of the sides in whole steps from the middle: low x, low y, high x, high y.
  std::array<int, 4> side{0, 0, 0, 0};
  const auto row_is_good = [&](std::size_t which, int at) {
    const std::size_t other = (which + 1) % 2;
    for (int k = side[other]; k <= side[other + 2]; ++k) {
      const double along_m = k * kStep_m, across_m = at * kStep_m;
      if (!(which % 2 == 0 ? is_good(across_m, along_m) : is_good(along_m, across_m))) return false;
    }
    return true;
  };
  const auto is_square = [&](int half) {
    const std::array<int, 4> before = side;
    side = {-half, -half, half, half};
    const bool good = row_is_good(0, -half) && row_is_good(1, -half) && row_is_good(2, half) &&
                      row_is_good(3, half);
    if (!good) side = before;
    return good;
  };
  int half = 1;
  while (is_square(half))
    ++half;
  for (std::size_t which = 0; which < side.size(); ++which) {
    const int outwards = which < 2 ? -1 : 1;
    while (row_is_good(which, side[which] + outwards))
      side[which] += outwards;
  }
  WorkspaceRectangle rectangle;
  rectangle.min_m = middle_m + Eigen::Vector2d(side[0], side[1]) * kStep_m;
  rectangle.max_m = middle_m + Eigen::Vector2d(side[2], side[3]) * kStep_m;
  return rectangle;
}

}  // namespace trocar::runtime
