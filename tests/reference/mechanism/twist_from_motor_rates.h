// SPDX-License-Identifier: Apache-2.0
// The inverse of motor rates = G twist, by least squares.
#pragma once

#include "runtime/device/four_legs/kinematics.h"

namespace trocar::runtime {

struct TwistResult {
  KinematicsStatus status;  ///< kBadInput if not finite; kSingular if G lacks full rank
  Twist twist_device = Twist::Zero();
  double residual_rad_per_s = 0;  ///< root mean square of the part that no plate motion explains
};
/// The plate's twist that fits eight motor rates best. The answer does not depend on units. The
/// rates of a real motion are fitted exactly.
TwistResult twist_from_motor_rates(const Jacobian& G, const MotorVector& motor_rad_per_s) noexcept;

}  // namespace trocar::runtime
