// SPDX-License-Identifier: Apache-2.0
// The limits beyond which the loop stops: where the plate may be, how fast, and what may be asked
// of the motors. Pure functions; each limit is a named fault. Called from the haptic thread.
//
// Laws (tests/limits_test.cpp):
//  1. Within its limit a check finds nothing, beyond it it names its own fault; what is not finite
//     is beyond every limit.
//  2. Speeds are smoothed over `speed_window_s`, so that an encoder's single count is no speed.
//  3. A motor's heat is its torque squared, smoothed over `thermal_s`, as a share of the continuous
//     torque squared: at most the continuous torque for ever is no overload, the peak torque
//     is one after thermal_s * ln(1 / (1 - (continuous / peak)^2)) from cold.
//  4. Torques rise no faster than `torque_rise_max_Nm_per_s`: the step from the last torques is
//     shortened as a whole, never motor by motor. Where no motor's torque grows beyond the
//     largest one before, as when a sheet gives way, nothing is shortened.
#pragma once

#include <array>

#include "formats/device_description.h"
#include "formats/recording.h"
#include "runtime/device/kinematics.h"
#include "runtime/device/pose.h"
#include "runtime/loop/safety.h"

namespace trocar::runtime {

struct SafetyLimits {
  double encoder_rate_max_rad_per_s = 60;  ///< of any encoder between two ticks
  double pose_residual_max_m = 0.5e-3;     ///< of the pose's fit to the upper chains
  double theta4_residual_max_rad = 0.01;   ///< measured against that of the fitted pose
  double inverse_condition_min = 0.02;     ///< of the Jacobian, at 0.05 m
  std::array<double, 3> workspace_min_m{-0.06, -0.06, 0.06};  ///< of the plate's origin
  std::array<double, 3> workspace_max_m{0.06, 0.06, 0.24};
  double plate_tilt_max_rad = 0.6;      ///< of the plate's z axis against {B}'s
  double speed_max_m_per_s = 2;         ///< of the plate's origin
  double turn_rate_max_rad_per_s = 40;  ///< of the plate
  double speed_window_s = 0.004;        ///< law 2
  double torque_max_Nm = 0;             ///< wanted of a motor; 0: the peak torque, never exceeded
  double torque_rise_max_Nm_per_s = 5000;  ///< law 4
  double torque_rise_time_max_s =
      0.02;                     ///< for which law 4 may act without a tick of half its step
  double thermal_s = 4;         ///< law 3
  double silence_max_s = 0.01;  ///< of the device, on its last state until then
  /// Between two ticks' starts. 0: time does not matter, nor do missed deadlines.
  double gap_max_s = 0.1;
  int missed_deadlines_max = 2;  ///< in a row; more are a fault
  SafetyTiming timing;
};

/// Between ticks.
struct LimitState {
  bool has_pose = false;
  Pose T_device_plate;  ///< of the last tick
  Twist twist_device = Twist::Zero();
  double rise_s = 0;                       ///< for which law 4 has acted
  MotorVector heat = MotorVector::Zero();  ///< law 3: share of what is a fault
};

/// kWorkspace or none.
Fault check_workspace(const SafetyLimits& limits, const Pose& T_device_plate) noexcept;

/// kSpeed or none; keeps the pose. `dt_s` since the last call. After has_pose = false the plate
/// counts as at rest.
Fault check_speed(const SafetyLimits& limits, const Pose& T_device_plate, double dt_s,
                  LimitState& state) noexcept;

/// kMotorOverload or none, after torques that were held for dt_s.
Fault check_heat(const SafetyLimits& limits, const DeviceDescription& device,
                 const MotorVector& tau_motor_Nm, double dt_s, LimitState& state) noexcept;

/// Law 4. Returns the torques and, in `shortened`, whether they differ from `wanted`.
MotorVector limit_rise(const MotorVector& last, const MotorVector& wanted, double rise_max_Nm,
                       bool& shortened) noexcept;

/// kTorqueLimit, kTorqueRate, kTorqueNotFinite or none. `wanted` becomes what may be written:
/// law 4, and the peak torque.
Fault limit_torques(const SafetyLimits& limits, const DeviceDescription& device,
                    const MotorVector& last_Nm, double dt_s, MotorVector& wanted_Nm,
                    LimitState& state) noexcept;

}  // namespace trocar::runtime
