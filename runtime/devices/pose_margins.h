// SPDX-License-Identifier: Apache-2.0
// The distances of a plate pose from the limits of the device and of the loop (limits.h).
#pragma once

#include "runtime/contact/tool.h"
#include "runtime/control/limits.h"
#include "runtime/device/hand_device.h"

namespace trocar::runtime {

/// Distances of a pose from the limits. `tilt_rad` and `tool_tilt_rad`, however, are the tilts
/// themselves, not their distances from the limits.
struct PoseMargins {
  DeviceMargins device;
  /// Smallest distance of the plate's origin from the sides of two workspaces: that of the loop's
  /// limits, and the one that the device itself states. Negative if the origin is outside at least
  /// one of the two.
  double box_m = 0;
  double tilt_rad = 0;       ///< angle between the z axes of the plate and of {B}
  double tool_tilt_rad = 0;  ///< angle between the tool's axis and the z axis of {B}
};
PoseMargins pose_margins(const DeviceSpecification& device, const SafetyLimits& limits,
                         const Tool& tool, const Pose& T_device_plate) noexcept;

/// Returns the fault that the loop raises at this pose, or none.
Fault pose_fault(const SafetyLimits& limits, const PoseMargins& margins) noexcept;

}  // namespace trocar::runtime
