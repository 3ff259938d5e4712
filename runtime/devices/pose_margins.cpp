// SPDX-License-Identifier: Apache-2.0
#include "runtime/devices/pose_margins.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "runtime/mechanism/jacobian.h"
#include "runtime/mechanism/singularity.h"

namespace trocar::runtime {
namespace {

double angle_to_z(const Eigen::Vector3d& axis) noexcept {
  return std::atan2(axis.head<2>().norm(), axis.z());
}

}  // namespace

PoseMargins pose_margins(const DeviceDescription& device, const SafetyLimits& limits,
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
  const InverseResult inverse = inverse_kinematics(device, T_device_plate);
  margins.pose = inverse.status;
  if (!margins.pose) return margins;
  const JacobianResult motion = jacobian(device, T_device_plate, inverse.joints);
  margins.pose = motion.status;
  if (!margins.pose) return margins;
  margins.joint_limit = check_joint_limits(device, encoder_angles(inverse.joints));
  margins.joint_rad = std::numeric_limits<double>::infinity();
  for (std::size_t leg = 0; leg < kLegs; ++leg) {
    for (std::size_t joint = 0; joint < 4; ++joint) {
      const double theta_rad = inverse.joints.theta_rad[leg][joint];
      const JointLimit& limit = device.joint_limit[joint];
      const double margin_rad = std::min(theta_rad - limit.min_rad, limit.max_rad - theta_rad);
      if (!(margin_rad < margins.joint_rad)) continue;
      margins.joint_rad = margin_rad;
      margins.leg = static_cast<std::int8_t>(leg + 1);
      margins.joint = static_cast<std::int8_t>(joint + 1);
    }
  }
  const Singularity singularity =
      measure_singularity(device, T_device_plate, inverse.joints, motion.G);
  margins.inverse_condition = singularity.inverse_condition;
  margins.branch_m = singularity.nearest_branch_m;
  return margins;
}

// The order is that of the loop's checks (haptic_loop.cpp).
Fault pose_fault(const SafetyLimits& limits, const PoseMargins& margins) noexcept {
  if (!margins.pose) return Fault::kPoseResidual;
  if (!margins.joint_limit) return Fault::kJointLimit;
  if (!(margins.inverse_condition >= kMechanism.inverse_condition_min &&
        margins.branch_m >= kMechanism.branch_distance_min_m)) {
    return Fault::kSingularity;
  }
  if (!(margins.box_m >= 0 && margins.tilt_rad <= limits.plate_tilt_max_rad)) {
    return Fault::kWorkspace;
  }
  return margins.tool_tilt_rad * kDegreesPerRadian <= kMaxTilt_deg ? Fault::kNone
                                                                   : Fault::kToolTilt;
}

}  // namespace trocar::runtime
