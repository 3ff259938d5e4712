// SPDX-License-Identifier: Apache-2.0
// A model of the motors. The functions convert joint torques to motor currents, limit the currents
// by an i2t thermal model, and compute the torques that compensate friction and weight. The haptic
// thread calls them: no allocation, no exception.
//
// Laws (tests/runtime/mechanism/motor_test.cpp). They hold while no current exceeds
// available_current(). `peak`, `continuous` and `peak_time` are the values of MotorModel.
//  1. Over any interval of length T the integral of the squared current is at most
//     continuous^2 T + capacity. The i2t capacity is (peak^2 - continuous^2) peak_time. A cold
//     motor can draw the peak current for three quarters of peak_time. Then the available current
//     begins to fall (kFoldBack).
//  2. The available current lies between continuous and peak, changes without jumps, and is the
//     peak again once the motor has cooled.
#pragma once

#include "formats/session/device_description.h"
#include "runtime/device/hand_device.h"
#include "runtime/mechanism/torque_allocation.h"

namespace trocar::runtime {

/// The available current falls from peak to continuous while the last quarter (kFoldBack) of the
/// i2t capacity is used up. A tick must be shorter than kFoldBack times peak_time; otherwise a
/// single tick could use up more than the remaining capacity.
inline constexpr double kFoldBack = 0.25;

/// Constants of the motors, in the order of MotorVector.
struct MotorModel {
  /// Joint torque per motor current: the motor's torque constant times the gear and bevel ratios.
  MotorVector Nm_per_A = MotorVector::Zero();
  /// The drive's peak current, or the current that gives the joint's peak torque if that is less.
  MotorVector peak_A = MotorVector::Zero();
  /// The drive's continuous current, or the current that gives the joint's continuous torque if
  /// that is less.
  MotorVector continuous_A = MotorVector::Zero();
  MotorVector peak_Nm = MotorVector::Zero();  ///< peak torque at the joint
  double peak_time_s = 0;                     ///< defines the i2t capacity (law 1)
  double coulomb_Nm = 0;                      ///< Coulomb friction at the joint
  double viscous_Nms_per_rad = 0;
};
MotorModel make_motor_model(const DeviceDescription& device) noexcept;

/// The i2t thermal state: the integral of I^2 - continuous^2 in A^2 s, never below 0. The haptic
/// thread keeps it between ticks. Zero means a cold motor.
struct MotorLoad {
  MotorVector excess_A2s = MotorVector::Zero();
};

/// Returns the motors' currents for these joint torques.
MotorVector motor_currents(const MotorModel& model, const MotorVector& tau_motor_Nm) noexcept;

/// Returns the thermal state after this current has flowed for `dt_s`. If the current is not
/// finite, the peak current is assumed.
MotorLoad advance(const MotorModel& model, const MotorLoad& load, const MotorVector& current_A,
                  double dt_s) noexcept;

/// Returns the largest fraction of its i2t capacity that a motor has used. The fraction is at most
/// 1 while no current exceeds available_current(). A motor without capacity (peak equals
/// continuous) counts as 0. `hottest` receives the index of the motor with the largest fraction. If
/// all fractions are 0, `hottest` does not change.
double i2t_fraction_used(const MotorModel& model, const MotorLoad& load,
                         int* hottest = nullptr) noexcept;

/// Returns the largest current that each motor may draw in this thermal state.
MotorVector available_current(const MotorModel& model, const MotorLoad& load) noexcept;
/// Returns the joint torque of the available current, which the caller passes to allocate_torques()
/// as the limit. For a cold motor this is exactly peak_Nm.
MotorVector available_torque(const MotorModel& model, const MotorLoad& load) noexcept;

/// Returns the torques that compensate friction and weight. The caller adds them to the rendered
/// torques. Weight is not compensated if G lacks full rank. Friction is not compensated if a motor
/// rate is not finite.
MotorVector compensation_torques(const DeviceDescription& device, const MotorModel& model,
                                 const Jacobian& G, const MotorVector& motor_rad_per_s,
                                 const CompensationOptions& options) noexcept;

/// Like allocate_torques(), but the motors also apply bias torques, such as compensation torques.
/// The limit for the rendered torques is what the bias leaves of the motor's limit: limit - |bias|.
/// So the rendered wrench keeps its direction, and the sum of bias and rendered torques is within
/// the limits. In the result, tau_motor_Nm is this sum, but wrench_device and scale describe the
/// rendered torques only. The result is kRefused if |bias| reaches a motor's limit.
AllocationResult allocate_torques_with_bias(const Jacobian& G, const Wrench& wrench_device,
                                            const MotorVector& limit_Nm,
                                            const MotorVector& bias_Nm) noexcept;

}  // namespace trocar::runtime
