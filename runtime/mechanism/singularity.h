// SPDX-License-Identifier: Apache-2.0
// Measures the distance of a pose from the mechanism's two kinds of singularity (Gosselin and
// Angeles). The haptic thread calls these functions: no allocation, no exception, bounded time.
//  - Loss of stiffness: the motors cannot resist some motion of the plate. The smallest singular
//    value of the Jacobian goes to 0.
//  - Limit of a leg's workspace: one of the leg's two chains (kinematics.h) is stretched or folded.
//    At other poses, the chain can have two shapes with the same end points, called its branches
//    (LegBranch). At this limit the two branches coincide, and the row of the Jacobian that belongs
//    to the chain's motor grows without bound. The distance from this limit is measured in metres.
#pragma once

#include <array>

#include "runtime/mechanism/jacobian.h"

namespace trocar::runtime {

struct BranchDistance {
  /// theta1_m belongs to the upper chain, which ends at the ball joint C. It is the distance of C
  /// to the nearest point at which the chain's two branches coincide. While C moves by less than
  /// theta1_m, in any direction, the chain cannot change its branch. theta4_m is the corresponding
  /// distance of D, the end of the lower chain. A negative distance means that the chain cannot
  /// reach the point.
  double theta1_m = 0, theta4_m = 0;
};

struct Singularity {
  /// The smallest singular value of the Jacobian: if the plate moves at 1 m/s in any direction, the
  /// vector of motor rates in rad/s is at least this long. In a rotation, 1 rad counts as
  /// kCharacteristicLength_m. The value is also a force in N: in the weakest direction, motor
  /// torques with a vector of length 1 N*m resist this force. The value is 0 at a loss of stiffness
  /// and if G is not finite. Its error is about 1e-13 of the largest singular value.
  double smallest_singular_value_per_m = 0;
  /// Smallest singular value divided by the largest one: at most 1; 0 at a singularity and if G
  /// is not finite.
  double inverse_condition = 0;
  std::array<BranchDistance, kLegs> branch;
  double nearest_branch_m = 0;    ///< the smallest distance in `branch`
  std::int8_t nearest_leg = 0;    ///< leg with the distance nearest_branch_m, 1..4
  std::int8_t nearest_joint = 0;  ///< its chain: 1 for the upper (theta1), 4 for the lower (theta4)
};

/// Computes all measures at a pose. Precondition: `joints` and `G` are those of the
/// pose (inverse_kinematics, jacobian).
Singularity measure_singularity(const DeviceDescription& device, const Pose& T_device_plate,
                                const JointAngles& joints, const Jacobian& G) noexcept;

}  // namespace trocar::runtime
