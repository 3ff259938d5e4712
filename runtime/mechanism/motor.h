// SPDX-License-Identifier: Apache-2.0
// The motors: torque constant, gear and bevel ratio between current and joint torque, peak and
// continuous current with an i2t thermal limit, and torques that compensate friction and weight.
// Called from the haptic thread: no allocation, no exception.
//
// The laws hold for a current that never exceeds available_current()
// (tests/runtime/mechanism/motor_test.cpp):
//  1. Over any interval of length T the integral of I^2 is at most continuous^2 T + capacity, with
//     the i2t capacity = (peak^2 - continuous^2) peak_time. From a cold motor, peak current is
//     available for three quarters of peak_time.
//  2. The available current lies between continuous and peak, changes without jumps, and is the
//     peak again once the motor has cooled.
#pragma once

#include "formats/session/device_description.h"
#include "runtime/mechanism/torque_allocation.h"

namespace trocar::runtime {

/// The last fraction of the i2t capacity, over which the available current falls from peak to
/// continuous. A tick must be shorter than this fraction of peak_time.
inline constexpr double kFoldBack = 0.25;

/// Constants of the motors, leg-major like MotorVector.
struct MotorModel {
  MotorVector Nm_per_A = MotorVector::Zero();  ///< joint torque per motor current
  /// The drive's peak current, or the current that gives the joint's peak torque if that is less.
  MotorVector peak_A = MotorVector::Zero();
  /// The drive's continuous current, or that of the joint's continuous torque if that is less.
  MotorVector continuous_A = MotorVector::Zero();
  MotorVector peak_Nm = MotorVector::Zero();  ///< peak torque at the joint
  double peak_time_s = 0;
  double coulomb_Nm = 0;  ///< Coulomb friction at the joint
  double viscous_Nms_per_rad = 0;
};
MotorModel make_motor_model(const DeviceDescription& device) noexcept;

/// The i2t thermal state: integral of I^2 - continuous^2 in A^2 s, never below 0. Kept by the
/// haptic thread between ticks; zero is a cold motor.
struct MotorLoad {
  MotorVector excess_A2s = MotorVector::Zero();
};

/// The motors' currents for these joint torques.
MotorVector motor_currents(const MotorModel& model, const MotorVector& tau_motor_Nm) noexcept;

/// The state after `dt_s` of this current. If the current is not finite, the peak is assumed.
MotorLoad advance(const MotorModel& model, const MotorLoad& load, const MotorVector& current_A,
                  double dt_s) noexcept;

/// The largest fraction of its i2t capacity that a motor has used; at most 1 while no current
/// exceeds available_current(). A motor without capacity (peak equals continuous) counts as 0.
/// `hottest` receives the number of that motor.
double i2t_fraction_used(const MotorModel& model, const MotorLoad& load,
                         int* hottest = nullptr) noexcept;

MotorVector available_current(const MotorModel& model, const MotorLoad& load) noexcept;
/// The available current as joint torque, which is the limit for allocate_torques. It is exactly
/// peak_Nm for a cold motor.
MotorVector available_torque(const MotorModel& model, const MotorLoad& load) noexcept;

struct CompensationOptions {
  bool friction = false;
  bool gravity = false;            ///< the plate's weight, by the description's gravity
  double friction_fraction = 0.8;  ///< below 1: an overcompensated device would move by itself
  double still_rad_per_s = 0.05;   ///< Coulomb compensation is proportional to slower rates
};

/// Torques that compensate friction and weight, to be added to the rendered torques. The
/// compensation of weight is zero if G lacks full rank, that of friction if a rate is not finite.
MotorVector compensation_torques(const DeviceDescription& device, const MotorModel& model,
                                 const Jacobian& G, const MotorVector& motor_rad_per_s,
                                 const CompensationOptions& options) noexcept;

/// allocate_torques() with bias torques, such as compensation, that the motors always apply.
/// tau_motor_Nm is the sum of bias and rendered torques; wrench_device and scale belong to the
/// rendered torques, which are allocated within limit - |bias|. So the rendered wrench keeps its
/// direction, and the sum keeps the limits. Refused if |bias| reaches a motor's limit.
AllocationResult allocate_torques_with_bias(const Jacobian& G, const Wrench& wrench_device,
                                            const MotorVector& limit_Nm,
                                            const MotorVector& bias_Nm) noexcept;

}  // namespace trocar::runtime
