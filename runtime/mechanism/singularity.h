// SPDX-License-Identifier: Apache-2.0
// How far a pose is from the mechanism's two kinds of singularity (Gosselin and Angeles). Called
// from the haptic thread: no allocation, no exception, bounded time.
//  - Loss of stiffness: the motors cannot hold some motion of the plate. The smallest singular
//    value of the Jacobian goes to 0.
//  - End of a leg's reach: the motor's row of the Jacobian grows without bound and the two assembly
//    branches of the chain meet. Measured as the distance to that, in metres.
#pragma once

#include <array>

#include "runtime/mechanism/jacobian.h"

namespace trocar::runtime {

struct BranchDistance {
  /// theta1_m: distance of the ball joint C to the nearest point at which th1's branches meet.
  /// theta4_m: distance of D to the nearest point at which th4's branches meet. While the point
  /// moves by less, in any direction, the branch cannot switch. Negative: out of reach by as much.
  double theta1_m = 0, theta4_m = 0;
};

struct Singularity {
  /// Smallest motor rate in rad/s of any plate motion of 1 m/s, a radian counting as the
  /// characteristic length. By duality also the force in N that a torque vector of length 1 N*m
  /// holds in the weakest direction. 0 at a loss of stiffness, and if G is not finite. Accurate to
  /// about 1e-13 of the largest.
  double smallest_singular_value_per_m = 0;
  double inverse_condition = 0;  ///< smallest over largest singular value; at most 1, 0 at a
                                 ///< singularity and if G is not finite
  std::array<BranchDistance, kLegs> branch;
  double nearest_branch_m = 0;    ///< the smallest of them
  std::int8_t nearest_leg = 0;    ///< 1..4
  std::int8_t nearest_joint = 0;  ///< 1 or 4
};

/// All measures at a pose. `joints` and `G` must be those of the pose (inverse_kinematics,
/// jacobian).
Singularity measure_singularity(const DeviceDescription& device, const Pose& T_device_plate,
                                const JointAngles& joints, const Jacobian& G,
                                double characteristic_length_m = kCharacteristicLength_m) noexcept;

}  // namespace trocar::runtime
