// SPDX-License-Identifier: Apache-2.0
// Between joint torque and motor current: torque constant, gear and bevel ratio,
// peak and continuous current with an i2t budget, and what may be added to the
// rendered torques to hide friction and weight. Called from the haptic thread: no
// allocation, no exception.
//
// Laws (tests/runtime/mechanism/motor_test.cpp), for a current that never exceeds available_current():
//  1. Over any stretch of time T the integral of I^2 is at most
//     continuous^2 T + budget, budget = (peak^2 - continuous^2) peak_time; from
//     rest, peak current lasts for three quarters of peak_time, then gives way.
//  2. The available current lies between continuous and peak, falls and rises
//     without jumps, and is the peak again after the budget has been paid back.
#pragma once

#include "formats/session/device_description.h"
#include "runtime/mechanism/torque_allocation.h"

namespace trocar::runtime {

/// The part of the i2t budget, at its end, over which the available current falls
/// from peak to continuous. A tick must be shorter than this part of peak_time.
inline constexpr double kFoldBack = 0.25;

/// What stays the same; leg-major as MotorVector.
struct MotorModel {
  MotorVector Nm_per_A = MotorVector::Zero();  ///< joint torque per motor current
  MotorVector peak_A = MotorVector::Zero();  ///< the drive's, or what gives the joint's peak torque
  MotorVector continuous_A = MotorVector::Zero();  ///< likewise
  MotorVector peak_Nm = MotorVector::Zero();       ///< at the joint
  double peak_time_s = 0;
  double coulomb_Nm = 0;  ///< at the joint
  double viscous_Nms_per_rad = 0;
};
MotorModel make_motor_model(const DeviceDescription& device) noexcept;

/// The i2t accumulator: what was drawn beyond the continuous current, A^2 s, at
/// least 0. The haptic thread's memory between ticks; zero is a cold motor.
struct MotorLoad {
  MotorVector excess_A2s = MotorVector::Zero();
};

/// The motors' currents for these joint torques.
MotorVector motor_currents(const MotorModel& model, const MotorVector& tau_motor_Nm) noexcept;

/// After `dt_s` of this current (peak is assumed where it is not finite).
MotorLoad advance(const MotorModel& model, const MotorLoad& load, const MotorVector& current_A,
                  double dt_s) noexcept;

/// The largest share of its budget that a motor has spent; at most 1 while the laws' condition
/// holds. A motor without a budget (peak is continuous) counts as 0.
double budget_spent(const MotorModel& model, const MotorLoad& load) noexcept;

MotorVector available_current(const MotorModel& model, const MotorLoad& load) noexcept;
/// The same at the joint: allocate_torques' limit. A cold motor's is exactly peak_Nm.
MotorVector available_torque(const MotorModel& model, const MotorLoad& load) noexcept;

struct CompensationOptions {
  bool friction = false;
  bool gravity = false;            ///< the plate's weight, by the description's gravity
  double friction_fraction = 0.8;  ///< below 1: a device pushed by too much would move by itself
  double still_rad_per_s = 0.05;   ///< below it Coulomb friction is compensated in proportion
};

/// Torques that hide friction and weight: to be added to the rendered ones. Gravity's
/// are zero where G does not allow it. Not finite rates give no friction part.
MotorVector compensation_torques(const DeviceDescription& device, const MotorModel& model,
                                 const Jacobian& G, const MotorVector& motor_rad_per_s,
                                 const CompensationOptions& options) noexcept;

/// allocate_torques beside torques that are spoken for: wrench_device and scale are the
/// rendered wrench's, tau_motor_Nm the sum. The rendered part gets the limits less
/// |beside| on both sides, so it is still never bent, and the sum keeps the limits.
/// Refused if some motor has nothing left.
AllocationResult allocate_torques_beside(const Jacobian& G, const Wrench& wrench_device,
                                         const MotorVector& limit_Nm,
                                         const MotorVector& beside_Nm) noexcept;

}  // namespace trocar::runtime
