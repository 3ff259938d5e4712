// SPDX-License-Identifier: Apache-2.0
// The limits of all six joints of every leg. check_joint_limits checks the four that have encoders.
#pragma once

#include "runtime/device/four_legs/kinematics.h"

namespace trocar::runtime {

/// False also for an angle that is not finite.
inline bool all_joints_within_limits(const DeviceDescription& device, const JointAngles& joints) {
  for (const auto& theta : joints.theta_rad) {
    for (std::size_t j = 0; j < kJointsPerLeg; ++j) {
      const JointLimit& limit = device.joint_limit[j];
      if (!(theta[j] >= limit.min_rad && theta[j] <= limit.max_rad)) return false;
    }
  }
  return true;
}

}  // namespace trocar::runtime
