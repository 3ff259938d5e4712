// SPDX-License-Identifier: Apache-2.0
// Computes eight motor torques from a wanted wrench (paper, Eq. 17-18), within the motors' limits.
// The haptic thread calls these functions: no allocation, no exception, bounded time.
//
// Laws. The laws hold unless the result is
// kRefused; then the torques and `scale` are 0. Let tau be the computed torques, `wanted` the
// wanted wrench, and G the Jacobian (kinematics.h). Let c be the torques with the smallest norm that
// produce `wanted`. The working limit of motor i is working_i = (1 - kTorqueReserve) limit_i. P
// projects torques onto the null space of G^T. |limit| is the norm of the vector of limits, and
// limit_min is the smallest limit.
//  1. |tau_i| <= limit_i, always.
//  2. G^T tau = scale * wanted, 0 < scale <= 1: the wrench keeps its direction.
//  3. If c is within the working limits, tau = c and scale = 1.
//  4. Otherwise, if any torques within the working limits produce `wanted`, then scale = 1. If none
//     do, scale is the largest factor for which some torques within the working limits produce
//     scale * wanted.
//  5. Among the torques that produce scale * wanted, tau minimises |tau|^2 plus a penalty on
//     torques above their working limits. The penalty is sum_i stiffness_i
//     max(0, |tau_i| - working_i)^2 with stiffness_i = (|limit| / (kTorqueReserve limit_i))^2.
//  6. Let the wrench or the pose change a little. Let dc be the resulting change of c, and dP that
//     of P. The norm of the change of tau is at most K (|dc| + |limit| |dP|), with
//     K = (2 + 1.5 sqrt(max stiffness)) (1 + |limit| / limit_min). If scale = 1 and the pose is
//     constant, the norm of the change is at most sqrt(1 + max stiffness / 4) |dc|. For eight equal
//     motors the factor of |dc| is then below 142.
//
// The reserve bounds the rate at which tau changes. Without a reserve, a wrench can be so large
// that only a single torque vector within the limits produces it. Write a basis of the null space
// as a matrix with one row for each motor. If several of these rows are nearly parallel (such as
// those of the four upper motors at any upright, centred pose), this torque vector changes
// arbitrarily fast with the pose. With a reserve the rate has a bound, which is inversely
// proportional to the reserve.
//
// Law 1 follows from law 5. Some torques y0 within the working limits produce scale * wanted. For
// them |y0| < |limit|, and the penalty is 0. Therefore the optimum satisfies
// stiffness_i excess_i^2 <= |y0|^2, where excess_i = |tau_i| - working_i, and it follows that
// excess_i < kTorqueReserve limit_i.
#pragma once

#include <cstdint>

#include "runtime/device/device.h"
#include "runtime/device/four_legs/kinematics.h"

namespace trocar::runtime {

/// Fraction of every limit that is held in reserve, so that torques change at a bounded rate (laws
/// 4 to 6).
inline constexpr double kTorqueReserve = 0.01;

enum class AllocationKind : std::uint8_t {
  kMinimumNorm,  ///< law 3: the torques with the smallest norm are within the working limits
  kNullSpace,    ///< law 4 with scale = 1: other torques render the full wrench
  kScaled,       ///< law 4 with scale < 1: the device cannot render the full wrench
  /// G or the wrench is not finite, a limit is not positive and finite, or G lacks full rank. The
  /// torques are zero.
  kRefused,
};

struct AllocationResult {
  AllocationKind kind = AllocationKind::kRefused;
  MotorVector tau_motor_Nm = MotorVector::Zero();
  Wrench wrench_device = Wrench::Zero();  ///< the delivered wrench G^T tau
  double scale = 0;                       ///< delivered wrench = scale * wanted wrench
  bool limited() const noexcept { return kind >= AllocationKind::kScaled; }
};

/// Allocates the torques. `wrench_device` is the wanted wrench [f; n] on the plate, about its
/// origin, in {B}. `G` is the Jacobian at the current pose. Each motor has its own positive limit.
AllocationResult allocate_torques(const Jacobian& G, const Wrench& wrench_device,
                                  const MotorVector& limit_Nm) noexcept;

/// Like the function above, with one limit for all motors.
AllocationResult allocate_torques(const Jacobian& G, const Wrench& wrench_device,
                                  double limit_Nm) noexcept;

}  // namespace trocar::runtime
