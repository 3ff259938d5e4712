// SPDX-License-Identifier: Apache-2.0
// Measures the distance of a pose from the mechanism's two kinds of singularity (Gosselin and
// Angeles). The haptic thread calls these functions: no allocation, no exception, bounded time.
//  - Loss of stiffness: the motors cannot resist some motion of the plate. The smallest singular
//    value of the Jacobian goes to 0.
//  - Limit of a leg's workspace: a motor's row of the Jacobian grows without bound, and the two
//    assembly branches (kinematics.h) of the motor's chain coincide. The distance from this limit
//    is measured in metres.
#pragma once

#include <array>

#include "runtime/mechanism/jacobian.h"

namespace trocar::runtime {

struct BranchDistance {
  /// theta1_m is the distance of the ball joint C to the nearest point at which th1's branches
  /// coincide. theta4_m is the distance of D to the nearest point at which th4's branches coincide.
  /// While C moves by less than theta1_m, in any direction, th1's branch cannot change; the same
  /// holds for D and th4. A negative distance means that the point is outside the workspace.
  double theta1_m = 0, theta4_m = 0;
};

struct Singularity {
  /// Smallest norm of the motor rates, in rad/s, over all plate motions of 1 m/s. For a rotation, a
  /// radian counts as the characteristic length. By duality this value is also the force in N that
  /// a torque vector of length 1 N*m can resist in the weakest direction. The value is 0 at a loss
  /// of stiffness and if G is not finite. Its error is about 1e-13 of the largest singular value.
  double smallest_singular_value_per_m = 0;
  /// Smallest singular value divided by the largest one: at most 1; 0 at a singularity and if G
  /// is not finite.
  double inverse_condition = 0;
  std::array<BranchDistance, kLegs> branch;
  double nearest_branch_m = 0;    ///< the smallest distance in `branch`
  std::int8_t nearest_leg = 0;    ///< leg with this distance, 1..4
  std::int8_t nearest_joint = 0;  ///< motor joint with this distance, 1 or 4
};

/// Computes all measures at a pose. Precondition: `joints` and `G` are those of the
/// pose (inverse_kinematics, jacobian).
Singularity measure_singularity(const DeviceDescription& device, const Pose& T_device_plate,
                                const JointAngles& joints, const Jacobian& G,
                                double characteristic_length_m = kCharacteristicLength_m) noexcept;

}  // namespace trocar::runtime
