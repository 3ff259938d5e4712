// SPDX-License-Identifier: Apache-2.0
// Safety limits of the four-legged device's encoders, pose and motors. A check that finds a limit
// exceeded returns a named fault, after which the loop renders no torques. To keep the limits of
// items 2 to 4 below, torques are reduced first. A fault follows only if the reduction lasts too
// long, or if a limit is exceeded in spite of the reduction. The haptic thread calls these
// functions. The caller keeps the state of the motors in a MotorState.
//
// Contract (tests/runtime/mechanism/mechanism_limits_test.cpp and, in the loop,
// tests/runtime/control/loop_motors_test.cpp):
//  1. A check returns kNone if its limit is not exceeded, and otherwise its own fault, with the
//     quantity, the quantity's value and the limit. A value that is not finite is beyond every
//     limit. A limit counts as exceeded if it is nan, or if it is a negative upper limit on a
//     quantity that cannot be negative.
//  2. The heat of a motor is computed by the model of motor.h, which sums the squared current over
//     time. As the motor warms up, the torque that is available from it falls smoothly from the
//     peak to the continuous torque. The wrench is scaled down along its own direction so that no
//     motor exceeds its thermal limit. This scaling is not a fault, because a force that falls
//     slowly is less surprising than one that vanishes. check_heat() returns the fault
//     kMotorOverload if a motor is beyond its thermal limit. This can happen only if the written
//     torques do not come from limit_torques() (item 4). check_overload() returns kMotorOverload if
//     an overload lasts longer than `overload_time_max_s`. A tick belongs to an overload if some
//     motor is too warm for its peak torque, and the rendered fraction of the wanted wrench is
//     below `overload_scale_min`. The first other tick ends the overload.
//  3. No motor's torque rises faster than `torque_rise_max_Nm_per_s`. If a torque would rise
//     faster, the changes of all eight torques are multiplied by one factor below 1, so that the
//     change of the wrench keeps its direction. What counts as a rise depends on the largest of the
//     eight magnitudes. If the largest magnitude does not grow in a tick, the rise of a torque is
//     the growth of its magnitude or, if the torque changes its sign, its new magnitude. A fall
//     towards zero, as at a puncture, is then not limited. If the largest magnitude grows in a
//     tick, the motors do not just release their torques, and the whole change of each torque, even
//     towards zero, counts as a rise.
//  4. The torques that limit_torques() returns are within every motor's limit. If a torque still
//     exceeds its motor's limit after item 3, all torques are scaled down by one factor. This can
//     happen if the limit has fallen since the last tick, because item 3 then may keep a torque
//     that is above the new limit.
#pragma once

#include "formats/session/fault_words.h"
#include "formats/session/recording.h"
#include "runtime/mechanism/motor.h"
#include "runtime/mechanism/singularity.h"

namespace trocar::runtime {

struct MechanismLimits {
  double encoder_rate_max_rad_per_s = 60;  ///< largest mean rate of an encoder between two readings
  double pose_residual_max_m =
      0.5e-3;  ///< largest ForwardResult::residual_m of forward_kinematics()
  /// Largest |measured theta4 - theta4 that follows from the pose|. theta4 is the joint angle of a
  /// leg's lower motor (kinematics.h).
  double theta4_residual_max_rad = 0.01;
  /// Smallest allowed Singularity::inverse_condition: the smallest singular value of the Jacobian
  /// divided by the largest one, where 1 rad counts as kCharacteristicLength_m (0.05 m). The value
  /// is 0 if the motors cannot resist some motion.
  double inverse_condition_min = 0.02;
  /// Smallest allowed Singularity::nearest_branch_m, the distance to a pose in which a leg can
  /// change its branch. (The branches of a leg are its possible shapes at the same pose of the
  /// plate; LegBranch.) If this limit were smaller than the error that a pose may have
  /// (pose_residual_max_m), a leg could change its branch undetected. Among 100,000 random poses of
  /// the workspace in tests/support/device_workspace.h the smallest distance is 0.749 mm
  /// (tests/runtime/mechanism/mechanism_limits_test.cpp).
  double branch_distance_min_m = 0.5e-3;
  double torque_max_Nm = 0;  ///< largest torque of a motor; 0: only its thermal state limits it
  double torque_rise_max_Nm_per_s = 5000;  ///< rate limit of item 3
  /// Longest time for which item 3 may reduce changes without a fault. MotorState::rise_s adds up
  /// the durations of the ticks in which item 3 reduces a change. The sum is set to 0 in a tick in
  /// which every wanted torque is close to the last torque: the difference must be at most half of
  /// the rise that is allowed in a tick.
  double torque_rise_time_max_s = 0.02;
  double overload_scale_min = 0.5;  ///< item 2: an overload renders less than this fraction
  double overload_time_max_s = 1;   ///< item 2: longest overload without a fault
};

/// State of the motors that is kept between ticks.
struct MotorState {
  double rise_s = 0;      ///< time for which item 3 has reduced changes (torque_rise_time_max_s)
  MotorLoad load;         ///< thermal state of item 2
  double overload_s = 0;  ///< duration of the present overload (item 2); 0: no overload
};

/// Returns kSingularity if the pose is too close to a singularity, and kNone otherwise.
FaultDetail check_singularity(const MechanismLimits& limits,
                              const Singularity& singularity) noexcept;

/// Updates the thermal state for torques that were held for dt_s. Returns kMotorOverload if a
/// thermal limit is exceeded (item 2), and kNone otherwise.
FaultDetail check_heat(const MotorModel& motor, const MotorVector& tau_motor_Nm, double dt_s,
                       MotorState& state) noexcept;

/// Returns kMotorOverload if a motor's thermal state is above `share_max` times the motor's i2t
/// capacity (motor.h), and kNone otherwise.
FaultDetail check_motor_heat(const MotorModel& motor, const MotorLoad& load,
                             double share_max) noexcept;

/// Call this once in a tick of length dt_s that renders `scale` times the wanted wrench. Returns
/// kMotorOverload if an overload has lasted too long (item 2), and kNone otherwise.
FaultDetail check_overload(const MechanismLimits& limits, const MotorModel& motor, double scale,
                           double dt_s, MotorState& state) noexcept;

/// Applies item 3 to the change from the torques `last` to the torques `wanted`, and returns the
/// new torques. `rise_max_Nm`: largest rise in this tick. Sets `shortened` to true if the change
/// was reduced, and otherwise to false.
MotorVector limit_rise(const MotorVector& last, const MotorVector& wanted, double rise_max_Nm,
                       bool& shortened) noexcept;

/// Applies items 3 and 4: changes `wanted_Nm` to the torques that may be written. `limit_Nm`: the
/// motors' limits, for example available_torque(); each must be positive. The caller must already
/// have scaled the wrench down, so that no wanted torque exceeds its limit. (Item 4 is meant only
/// for torques that item 3 has kept too large.) Returns kTorqueLimit if a wanted torque exceeds
/// torque_max_Nm or, if torque_max_Nm is 0, its motor's limit. Returns kTorqueRate if item 3 has
/// reduced changes for too long, kTorqueNotFinite if a torque is not finite, and kNone otherwise.
FaultDetail limit_torques(const MechanismLimits& limits, const MotorVector& limit_Nm,
                          const MotorVector& last_Nm, double dt_s, MotorVector& wanted_Nm,
                          MotorState& state) noexcept;

}  // namespace trocar::runtime
