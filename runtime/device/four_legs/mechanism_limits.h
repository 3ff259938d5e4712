// SPDX-License-Identifier: Apache-2.0
// Limits of the four-legged device: singularities, motors, and safety limits.
#pragma once

#include <array>

#include "formats/session/device_description.h"
#include "formats/session/faults.h"
#include "formats/session/recording.h"
#include "runtime/device/four_legs/kinematics.h"
#include "runtime/device/four_legs/torque_allocation.h"
#include "runtime/device/hand_device.h"

namespace trocar::runtime {

// Measures the distance of a pose from the mechanism's two kinds of singularity (Gosselin and
// Angeles). The haptic thread calls these functions: no allocation, no exception, bounded time.
//  - Loss of stiffness: the motors cannot resist some motion of the plate. The smallest singular
//    value of the Jacobian goes to 0.
//  - Limit of a leg's workspace: one of the leg's two chains (kinematics.h) is stretched or folded.
//    At other poses, the chain can have two shapes with the same end points, called its branches
//    (LegBranch). At this limit the two branches coincide, and the row of the Jacobian that belongs
//    to the chain's motor grows without bound. The distance from this limit is measured in metres.

struct BranchDistance {
  /// theta1_m belongs to the upper chain, which ends at the ball joint C. It is the distance of C
  /// to the nearest point at which the chain's two branches coincide. While C moves by less than
  /// theta1_m, in any direction, the chain cannot change its branch. theta4_m is the corresponding
  /// distance of D, the end of the lower chain. A negative distance means that the chain cannot
  /// reach the point.
  double theta1_m = 0, theta4_m = 0;
};

struct Singularity {
  /// The smallest singular value of the Jacobian: if the plate moves at 1 m/s in any direction, the
  /// vector of motor rates in rad/s is at least this long. In a rotation, 1 rad counts as
  /// kCharacteristicLength_m. The value is also a force in N: in the weakest direction, motor
  /// torques with a vector of length 1 N*m resist this force. The value is 0 at a loss of stiffness
  /// and if G is not finite. Its error is about 1e-13 of the largest singular value.
  double smallest_singular_value_per_m = 0;
  /// Smallest singular value divided by the largest one: at most 1; 0 at a singularity and if G
  /// is not finite.
  double inverse_condition = 0;
  std::array<BranchDistance, kLegs> branch;
  double nearest_branch_m = 0;    ///< the smallest distance in `branch`
  std::int8_t nearest_leg = 0;    ///< leg with the distance nearest_branch_m, 1..4
  std::int8_t nearest_joint = 0;  ///< its chain: 1 for the upper (theta1), 4 for the lower (theta4)
};

/// Computes all measures at a pose. Precondition: `joints` and `G` are those of the
/// pose (inverse_kinematics, jacobian).
Singularity measure_singularity(const DeviceDescription& device, const Pose& T_device_plate,
                                const JointAngles& joints, const Jacobian& G) noexcept;

// A model of the motors. The functions convert joint torques to motor currents, limit the currents
// by an i2t thermal model, and compute the torques that compensate friction and weight. The haptic
// thread calls them: no allocation, no exception.
//
// Laws. They hold while no current exceeds
// available_current(). `peak`, `continuous` and `peak_time` are the values of MotorModel.
//  1. Over any interval of length T the integral of the squared current is at most
//     continuous^2 T + capacity. The i2t capacity is (peak^2 - continuous^2) peak_time. A cold
//     motor can draw the peak current for three quarters of peak_time. Then the available current
//     begins to fall (kFoldBack).
//  2. The available current lies between continuous and peak, changes without jumps, and is the
//     peak again once the motor has cooled.

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

// Safety limits of the four-legged device's encoders, pose and motors. A check that finds a limit
// exceeded returns a named fault, after which the loop renders no torques. To keep the limits of
// items 2 to 4 below, torques are reduced first. A fault follows only if the reduction lasts too
// long, or if a limit is exceeded in spite of the reduction. The haptic thread calls these
// functions. The caller keeps the state of the motors in a MotorState.
//
// Contract:
//  1. A check returns kNone if its limit is not exceeded, and otherwise its own fault, with the
//     quantity, the quantity's value and the limit. A value that is not finite is beyond every
//     limit. A limit counts as exceeded if it is nan, or if it is a negative upper limit on a
//     quantity that cannot be negative.
//  2. The heat of a motor is computed by the model above, which sums the squared current over
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
  /// (tests/runtime/device/four_legs/mechanism_limits_test.cpp).
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
/// capacity, and kNone otherwise.
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
