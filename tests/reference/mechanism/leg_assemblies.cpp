// SPDX-License-Identifier: Apache-2.0
#include "tests/reference/mechanism/leg_assemblies.h"

#include <cmath>

#include "runtime/device/four_legs/kinematics.h"

namespace trocar::runtime {

std::array<LegAssembly, kBranchesPerLeg> leg_assemblies(const DeviceDescription& device,
                                                        const Pose& T_device_plate,
                                                        int leg) noexcept {
  constexpr double kUnitTolerance = 1e-9;  // of the quaternion's squared length
  const bool good = is_finite(T_device_plate) &&
                    std::abs(T_device_plate.q.squaredNorm() - 1) <= kUnitTolerance && leg >= 0 &&
                    leg < kLegs;
  std::array<LegAssembly, kBranchesPerLeg> all;
  for (int b = 0; b < kBranchesPerLeg; ++b) {
    LegAssembly& each = all[b];
    each.branch = {b < 2 ? 1 : -1, b % 2 == 0 ? 1 : -1};
    if (!good) {
      each.status.failure = KinematicsFailure::kBadInput;
      continue;
    }
    const Eigen::Vector3d C = T_device_plate * leg::plate_joint(device.geometry, leg);
    each.status = leg::inverse(device, leg::to_leg(leg, C), each.branch, each.theta_rad);
    if (!each.status) each.status.leg = leg + 1;
  }
  return all;
}

}  // namespace trocar::runtime
