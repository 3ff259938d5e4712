// SPDX-License-Identifier: Apache-2.0
// First-order kinematics (paper, section III.C): motor rates = G twist, and by
// duality wrench = G^T motor torques (Eq. 17). Twist and wrench are of the plate's
// origin, in {B}: [v; omega], [f; n]. Two independent forms, held against each
// other and against central differences by tests/runtime/mechanism/jacobian_test.cpp.
// Called from the haptic thread: no allocation, no exception.
#pragma once

#include <Eigen/Core>

#include "formats/session/device_description.h"
#include "runtime/mechanism/kinematics.h"

namespace trocar::runtime {

/// Rows: motors, leg-major th1, th4; columns: v in m/s, omega in rad/s.
using Jacobian = Eigen::Matrix<double, kMotors, 6>;

struct JacobianResult {
  KinematicsStatus status;  ///< kSingular names the leg and motor joint that is stretched or folded
  Jacobian G = Jacobian::Zero();  ///< valid only if status holds
};

/// Compact form, from differentiating |C - E| = l2 and |D - F| = l4. `joints`
/// must be the pose's own (inverse_kinematics). About 200 multiplications.
JacobianResult jacobian(const DeviceDescription& device, const Pose& T_device_plate,
                        const JointAngles& joints) noexcept;

/// The paper's influence-coefficient form, Eq. 4-16: the upper chain's 3 x 3
/// coefficient matrix inverted, the lower chain's likewise, and row selection.
JacobianResult influence_jacobian(const DeviceDescription& device, const Pose& T_device_plate,
                                  const JointAngles& joints) noexcept;

/// What weighs rotation against translation: about the plate's radius.
inline constexpr double kCharacteristicLength_m = 0.05;

/// Least and largest singular value of G with rotation made commensurate by a
/// characteristic length (columns of omega divided by it), each to about 1e-13 of the largest.
/// Both 0 if G is not finite.
struct SingularRange {
  double smallest = 0, largest = 0;
};
SingularRange singular_range(const Jacobian& G,
                             double characteristic_length_m = kCharacteristicLength_m) noexcept;

/// Smallest over largest of these. 0 at a singularity or if G is not finite; at most 1.
/// More measures: singularity.h.
double inverse_condition(const Jacobian& G,
                         double characteristic_length_m = kCharacteristicLength_m) noexcept;

/// Motor rates in rad/s of a plate's motion.
inline MotorVector motor_rates(const Jacobian& G, const Twist& twist_device) noexcept {
  return G * twist_device;
}

struct TwistResult {
  KinematicsStatus status;  ///< kBadInput if not finite; kSingular if G lacks full rank
  Twist twist_device = Twist::Zero();
  double residual_rad_per_s = 0;  ///< root mean square of what no motion of the plate explains
};
/// The plate's twist that fits eight motor rates best (least squares; the answer does
/// not depend on units). Rates of a real motion are fitted exactly.
TwistResult twist_from_motor_rates(const Jacobian& G, const MotorVector& motor_rad_per_s) noexcept;

}  // namespace trocar::runtime
