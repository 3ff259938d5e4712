// SPDX-License-Identifier: Apache-2.0
// Every way to assemble a leg at a pose. The device is built in one of them, which
// inverse_kinematics gives.
#pragma once

#include <array>

#include "runtime/device/four_legs/kinematics.h"

namespace trocar::runtime {

inline constexpr int kBranchesPerLeg = 4;

struct LegAssembly {
  LegBranch branch;
  KinematicsStatus status;
  std::array<double, kJointsPerLeg> theta_rad{};  ///< valid only if status holds
};

/// Leg 0..3 at a pose, with (th1, th4) on the branches ++, +-, -+, --. The legs choose
/// independently, so a pose has up to 4^4 = 256 assemblies. The passive joints add none: th3 and
/// pi - th3 with th2 half a turn further place the links alike, and so do th6 and th5.
std::array<LegAssembly, kBranchesPerLeg> leg_assemblies(const DeviceDescription& device,
                                                        const Pose& T_device_plate,
                                                        int leg) noexcept;

}  // namespace trocar::runtime
