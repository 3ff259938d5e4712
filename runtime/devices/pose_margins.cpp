// SPDX-License-Identifier: Apache-2.0
#include "runtime/devices/pose_margins.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace trocar::runtime {
namespace {

double angle_to_z(const Eigen::Vector3d& axis) noexcept {
  return std::atan2(axis.head<2>().norm(), axis.z());
}

}  // namespace

PoseMargins pose_margins(const DeviceSpecification& device, const SafetyLimits& limits,
                         const Tool& tool, const Pose& T_device_plate) noexcept {
  PoseMargins margins;
  margins.box_m = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < 3; ++i) {
    const double at_m = T_device_plate.p_m[static_cast<Eigen::Index>(i)];
    margins.box_m = std::min(
        {margins.box_m, at_m - limits.workspace_min_m[i], limits.workspace_max_m[i] - at_m});
  }
  margins.tilt_rad = angle_to_z(T_device_plate.q * Eigen::Vector3d::UnitZ());
  margins.tool_tilt_rad = angle_to_z(T_device_plate.q * tool.axis_plate);
  margins.device = device.margins(T_device_plate);
  margins.box_m = std::min(margins.box_m, margins.device.box_m);
  return margins;
}

// The order is that of the loop's checks (haptic_loop.cpp).
Fault pose_fault(const SafetyLimits& limits, const PoseMargins& margins) noexcept {
  if (margins.device.fault != Fault::kNone) return margins.device.fault;
  if (!(margins.box_m >= 0 && margins.tilt_rad <= limits.plate_tilt_max_rad)) {
    return Fault::kWorkspace;
  }
  return margins.tool_tilt_rad * kDegreesPerRadian <= kMaxTilt_deg ? Fault::kNone
                                                                   : Fault::kToolTilt;
}

}  // namespace trocar::runtime
