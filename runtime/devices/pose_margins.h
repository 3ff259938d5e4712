// SPDX-License-Identifier: Apache-2.0
// The distances of a pose from the limits of the device and the safety layer.
// Tests: tests/runtime/checking/hand_path_test.cpp
#pragma once

#include <cstdint>
#include <numbers>

#include "formats/session/device_description.h"
#include "runtime/contact/tool.h"
#include "runtime/control/limits.h"
#include "runtime/mechanism/mechanism_limits.h"

namespace trocar::runtime {

inline constexpr double kDegreesPerRadian = 180 / std::numbers::pi;
/// The limits of the mechanism in every session; no program changes them.
inline constexpr MechanismLimits kMechanism;

/// Distances of a pose from the limits; a negative distance is beyond the limit.
struct PoseMargins {
  KinematicsStatus pose;  ///< status of the inverse kinematics and of the Jacobian
  double box_m = 0;       ///< distance of the plate's origin from the nearest workspace side
  double tilt_rad = 0;    ///< angle between the z axes of the plate and of {B}
  double tool_tilt_rad = 0;
  // The following members are valid only if `pose` is kOk.
  KinematicsStatus joint_limit;  ///< status of the limits of th1..th4
  double joint_rad = 0;          ///< smallest distance of th1..th4 from their limits
  std::int8_t leg = 0, joint = 0;
  double inverse_condition = 0;
  double branch_m = 0;  ///< Singularity::nearest_branch_m
};
PoseMargins pose_margins(const DeviceDescription& device, const SafetyLimits& limits,
                         const Tool& tool, const Pose& T_device_plate) noexcept;

/// Returns the fault with which the loop stops at this pose, or none.
Fault pose_fault(const SafetyLimits& limits, const PoseMargins& margins) noexcept;

}  // namespace trocar::runtime
