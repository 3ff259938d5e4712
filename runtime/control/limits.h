// SPDX-License-Identifier: Apache-2.0
// Safety limits of the plate's pose and speed and of the motors. Pure functions; exceeding a limit
// is a named fault, which stops the loop. Called from the haptic thread.
//
// Contract (limits_test.cpp and, in the loop, loop_motors_test.cpp in tests/runtime/control/):
//  1. A check returns kNone within its limit and its own fault beyond it, with the quantity, its
//     value and the limit. A value that is not finite is beyond every limit. A limit of nan always trips, and so does a negative limit of a
//     quantity that cannot be negative.
//  2. Speeds are smoothed over `speed_window_s`, so that one encoder count is not read as a speed.
//  3. A motor's thermal state is the i2t model of motor.h; it sets the torque available from the
//     motor. As it warms up that torque falls smoothly from peak to continuous, the wrench is
//     scaled down along its own direction, and no motor exceeds its thermal limit. That is not a
//     fault: a force that falls slowly is less surprising than one that vanishes. kMotorOverload is
//     the fault where this is not enough: a thermal limit was exceeded (torques other than those of
//     item 5 were written), or derated motors have rendered less than `overload_scale_min` of the
//     wanted wrench in every tick of `overload_time_max_s`.
//  4. No motor's torque rises faster than `torque_rise_max_Nm_per_s`: where one would, the whole
//     step from the last torques is shortened by one factor, so that the wrench keeps its
//     direction. A torque rises by what it grows in magnitude; of a reversal, by what is beyond
//     zero. A fall towards zero is free, as at a puncture, unless the largest torque grows: then
//     every change counts.
//  5. Torques that limit_torques() returns are within every motor's limit; where item 4 leaves
//     more, all torques are scaled down by one factor.
#pragma once

#include <array>

#include "formats/session/device_description.h"
#include "formats/session/fault_words.h"
#include "formats/session/recording.h"
#include "runtime/control/safety.h"
#include "runtime/mechanism/kinematics.h"
#include "runtime/mechanism/motor.h"
#include "runtime/mechanism/pose.h"
#include "runtime/mechanism/singularity.h"

namespace trocar::runtime {

struct SafetyLimits {
  double encoder_rate_max_rad_per_s = 60;  ///< rate of any encoder between two ticks
  double pose_residual_max_m = 0.5e-3;     ///< residual of the pose's fit to the upper chains
  double theta4_residual_max_rad = 0.01;   ///< measured theta4 minus theta4 of the fitted pose
  double inverse_condition_min =
      0.02;  ///< inverse condition of the Jacobian, with lengths over 0.05 m
  /// Singularity::nearest_branch_m. At least the error that a pose may have (pose_residual_max_m),
  /// so that a leg cannot change its branch undetected. The least of 100,000 poses of the stated
  /// workspace is 0.749 mm (tests/runtime/control/limits_test.cpp).
  double branch_distance_min_m = 0.5e-3;
  std::array<double, 3> workspace_min_m{-0.06, -0.06, 0.06};  ///< bound of the plate's origin
  std::array<double, 3> workspace_max_m{0.06, 0.06, 0.24};
  double plate_tilt_max_rad = 0.6;          ///< angle between the plate's z axis and {B}'s
  double speed_max_m_per_s = 2;             ///< speed of the plate's origin
  double rotation_rate_max_rad_per_s = 40;  ///< rotation rate of the plate
  double speed_window_s = 0.004;            ///< item 2
  double torque_max_Nm = 0;  ///< torque of each motor; 0: what its thermal state leaves available
  double torque_rise_max_Nm_per_s = 5000;  ///< item 4
  /// How long item 4 may act; a tick whose step is at most half the limit starts the time again.
  double torque_rise_time_max_s = 0.02;
  double overload_scale_min = 0.5;  ///< item 3
  double overload_time_max_s = 1;   ///< item 3
  /// Energy released to the hand within 0.1 s beyond what was stored (energy_limit.h).
  double energy_limit_J = 0.05;
  /// Time without data from the device; until then the loop runs on its last state.
  double no_data_max_s = 0.01;
  /// Between the starts of two ticks. 0: neither this nor missed deadlines are checked.
  double gap_max_s = 0.1;
  int missed_deadlines_max = 2;  ///< in a row; more are a fault
  SafetyTiming timing;
};

/// Memory between ticks.
struct LimitState {
  bool has_pose = false;
  Pose T_device_plate;  ///< pose of the last tick
  Twist twist_device = Twist::Zero();
  double rise_s = 0;      ///< time for which item 4 has acted
  MotorLoad load;         ///< item 3
  double overload_s = 0;  ///< time with too little of the wanted wrench rendered, item 3
};

/// kWorkspace or none.
FaultDetail check_workspace(const SafetyLimits& limits, const Pose& T_device_plate) noexcept;

/// kSpeed or none; stores the pose. `dt_s`: time since the last call. While has_pose is false the
/// plate is taken to be at rest.
FaultDetail check_speed(const SafetyLimits& limits, const Pose& T_device_plate, double dt_s,
                        LimitState& state) noexcept;

/// kSingularity or none.
FaultDetail check_singularity(const SafetyLimits& limits, const Singularity& singularity) noexcept;

/// kMotorOverload or none, after torques that were held for dt_s: item 3, thermal limit exceeded.
FaultDetail check_heat(const MotorModel& motor, const MotorVector& tau_motor_Nm, double dt_s,
                       LimitState& state) noexcept;

/// kMotorOverload if a motor's thermal state is above `share_max` times its limit.
FaultDetail check_motor_heat(const MotorModel& motor, const MotorLoad& load,
                             double share_max) noexcept;

/// kMotorOverload or none, in a tick of dt_s that renders `scale` of the wanted wrench: item 3, too
/// little rendered for too long.
FaultDetail check_overload(const SafetyLimits& limits, const MotorModel& motor, double scale,
                           double dt_s, LimitState& state) noexcept;

/// Item 4. Returns the torques and, in `shortened`, whether they differ from `wanted`.
MotorVector limit_rise(const MotorVector& last, const MotorVector& wanted, double rise_max_Nm,
                       bool& shortened) noexcept;

/// kTorqueLimit, kTorqueRate, kTorqueNotFinite or none. `wanted_Nm` becomes the torques that may be
/// written: items 4 and 5. `limit_Nm`: positive, such as from available_torque().
FaultDetail limit_torques(const SafetyLimits& limits, const MotorVector& limit_Nm,
                          const MotorVector& last_Nm, double dt_s, MotorVector& wanted_Nm,
                          LimitState& state) noexcept;

}  // namespace trocar::runtime
