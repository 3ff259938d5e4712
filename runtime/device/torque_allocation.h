// SPDX-License-Identifier: Apache-2.0
// From a wanted wrench to eight motor torques: paper Eq. 17-18 with the motors'
// limits respected. Called from the haptic thread: no allocation, no exception,
// a fixed number of operations.
//
// Laws (tests/torque_allocation_test.cpp):
//  1. |tau_i| <= limit_i, always and exactly.
//  2. G^T tau = scale * wanted, 0 <= scale <= 1: the wrench is never bent.
//  3. If the minimum-norm torques (G^T)^+ wanted keep the limits, they are the
//     result, and scale = 1.
//  4. Else, if any torques within the limits give `wanted`, the result is the one
//     of them that is nearest to the minimum-norm torques, which is also the one
//     of least norm; scale = 1.
//  5. Else scale is the largest feasible one (less kScaleMargin, relative), and
//     the torques are those of law 4 for scale * wanted.
// The torques are a continuous function of wrench, G and limits wherever G keeps
// full rank: laws 3-5 pick the least-norm point of a polytope that moves
// continuously. They may still move fast where that polytope is about to vanish:
// some hundred N*m per N within the last fractions of a newton before law 5.
#pragma once

#include <cstdint>

#include "runtime/device/jacobian.h"
#include "runtime/device/kinematics.h"
#include "runtime/device/pose.h"

namespace trocar::runtime {

/// Relative distance kept from the largest feasible scale, so that the set of
/// feasible torques never shrinks to a point that rounding could miss.
inline constexpr double kScaleMargin = 1e-10;

enum class Allocation : std::uint8_t {
  kMinimumNorm,  ///< law 3
  kNullSpace,    ///< law 4
  kScaled,       ///< law 5: the device cannot render the wrench in full
  kRefused,      ///< G or the wrench is not finite, a limit is not positive and finite, or G
                 ///< lacks full rank; torques are zero
};

struct AllocationResult {
  Allocation kind = Allocation::kRefused;
  MotorVector tau_motor_Nm = MotorVector::Zero();
  Wrench wrench_device = Wrench::Zero();  ///< delivered: G^T tau
  double scale = 0;                       ///< delivered over wanted
  bool limited() const noexcept { return kind >= Allocation::kScaled; }
};

/// `wrench_device`: wanted [f; n] on the plate about its origin in {B}; `G` at
/// the current pose; one positive limit a motor.
AllocationResult allocate_torques(const Jacobian& G, const Wrench& wrench_device,
                                  const MotorVector& limit_Nm) noexcept;

/// The same with one limit for all motors.
AllocationResult allocate_torques(const Jacobian& G, const Wrench& wrench_device,
                                  double limit_Nm) noexcept;

}  // namespace trocar::runtime
