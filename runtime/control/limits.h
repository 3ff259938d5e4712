// SPDX-License-Identifier: Apache-2.0
// The limits beyond which the loop stops: where the plate may be, how fast, and what may be asked
// of the motors. Pure functions; each limit is a named fault. Called from the haptic thread.
//
// Laws (tests/runtime/control/limits_test.cpp; in the loop: tests/runtime/control/loop_motors_test.cpp):
//  1. Within its limit a check finds nothing, beyond it it names its own fault; what is not finite
//     is beyond every limit. A limit that is nan permits nothing, nor does a negative one of what
//     cannot be negative.
//  2. Speeds are smoothed over `speed_window_s`, so that an encoder's single count is no speed.
//  3. A motor's heat is the i2t account of motor.h. What may be asked of the motors is what it
//     leaves them: as a budget is spent torques give way, smoothly and along the wanted wrench,
//     from peak to continuous, and no motor gets warmer than its budget allows. That is no fault:
//     a wall that softens surprises a hand less than one that is gone. kMotorOverload is named
//     where that is not enough: a budget is overdrawn (other torques were written than those of
//     law 5), or motors that have given way have rendered less than `overload_scale_min` of the
//     wanted wrench for `overload_time_max_s`, without a tick in between.
//  4. Torques rise no faster than `torque_rise_max_Nm_per_s`: the step from the last torques is
//     shortened as a whole, never motor by motor. Where no motor's torque grows beyond the
//     largest one before, as when a sheet gives way, nothing is shortened.
//  5. What limit_torques() lets through is within every motor's limit; where a limit has fallen
//     below what law 4 leaves, the torques are scaled down as a whole.
#pragma once

#include <array>

#include "formats/session/device_description.h"
#include "formats/session/recording.h"
#include "runtime/mechanism/kinematics.h"
#include "runtime/mechanism/motor.h"
#include "runtime/mechanism/pose.h"
#include "runtime/mechanism/singularity.h"
#include "runtime/control/safety.h"

namespace trocar::runtime {

struct SafetyLimits {
  double encoder_rate_max_rad_per_s = 60;  ///< of any encoder between two ticks
  double pose_residual_max_m = 0.5e-3;     ///< of the pose's fit to the upper chains
  double theta4_residual_max_rad = 0.01;   ///< measured against that of the fitted pose
  double inverse_condition_min = 0.02;     ///< of the Jacobian, at 0.05 m
  /// Singularity::nearest_branch_m: not less than a pose may be wrong by (pose_residual_max_m), so
  /// that a leg cannot change its branch unseen. The least of 100,000 poses of the stated workspace
  /// is 0.749 mm (tests/runtime/control/limits_test.cpp).
  double branch_distance_min_m = 0.5e-3;
  std::array<double, 3> workspace_min_m{-0.06, -0.06, 0.06};  ///< of the plate's origin
  std::array<double, 3> workspace_max_m{0.06, 0.06, 0.24};
  double plate_tilt_max_rad = 0.6;         ///< of the plate's z axis against {B}'s
  double speed_max_m_per_s = 2;            ///< of the plate's origin
  double turn_rate_max_rad_per_s = 40;     ///< of the plate
  double speed_window_s = 0.004;           ///< law 2
  double torque_max_Nm = 0;                ///< wanted of a motor; 0: what its heat leaves it
  double torque_rise_max_Nm_per_s = 5000;  ///< law 4
  double torque_rise_time_max_s =
      0.02;                         ///< for which law 4 may act without a tick of half its step
  double overload_scale_min = 0.5;  ///< law 3
  double overload_time_max_s = 1;   ///< law 3
  double silence_max_s = 0.01;      ///< of the device, on its last state until then
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
  double rise_s = 0;      ///< for which law 4 has acted
  MotorLoad load;         ///< law 3
  double overload_s = 0;  ///< for which too little of the wanted wrench was rendered, law 3
};

/// kWorkspace or none.
Fault check_workspace(const SafetyLimits& limits, const Pose& T_device_plate) noexcept;

/// kSpeed or none; keeps the pose. `dt_s` since the last call. After has_pose = false the plate
/// counts as at rest.
Fault check_speed(const SafetyLimits& limits, const Pose& T_device_plate, double dt_s,
                  LimitState& state) noexcept;

/// kSingularity or none.
Fault check_singularity(const SafetyLimits& limits, const Singularity& singularity) noexcept;

/// kMotorOverload or none, after torques that were held for dt_s: law 3's overdrawn budget.
Fault check_heat(const MotorModel& motor, const MotorVector& tau_motor_Nm, double dt_s,
                 LimitState& state) noexcept;

/// kMotorOverload or none, in a tick of dt_s that renders `scale` of the wanted wrench: the rest of
/// law 3.
Fault check_overload(const SafetyLimits& limits, const MotorModel& motor, double scale, double dt_s,
                     LimitState& state) noexcept;

/// Law 4. Returns the torques and, in `shortened`, whether they differ from `wanted`.
MotorVector limit_rise(const MotorVector& last, const MotorVector& wanted, double rise_max_Nm,
                       bool& shortened) noexcept;

/// kTorqueLimit, kTorqueRate, kTorqueNotFinite or none. `wanted` becomes what may be written: laws
/// 4 and 5. `limit_Nm`: positive, such as available_torque()'s.
Fault limit_torques(const SafetyLimits& limits, const MotorVector& limit_Nm,
                    const MotorVector& last_Nm, double dt_s, MotorVector& wanted_Nm,
                    LimitState& state) noexcept;

}  // namespace trocar::runtime
