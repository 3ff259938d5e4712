// SPDX-License-Identifier: Apache-2.0
// One tick of the haptic loop, the same in real and in virtual time. The input of a tick is the
// pose that a device measures. The outputs are the wrench that the device is to render, and one row
// of the recording. A tick does not allocate, lock or throw.
//
// Contract, in addition to the contracts of safety.h and passivity.h:
//  1. The loop writes only commands that the device has prepared (hand_device.h), so all commands
//     are within the device's limits.
//  2. When a fault ends the state `running` (safety.h), the command goes to zero. It follows the
//     ramp of safety.h, which starts from the last command written. After the fault kEnergyLimit
//     there is no ramp: the command is zero in the same tick. If a command cannot be written, this
//     is a fault, too; the ramp then starts in the next tick, from the command that could not be
//     written. In the states `idle`, `ready` and `recovering`, and in `fault` after the ramp, the
//     force is zero.
//  3. The row holds every input of the tick, so replaying the rows gives the same commands.
//  4. The device gives each reading (a device state) a time stamp of the device's clock. The
//     differences of these time stamps determine four durations: the interval between two poses,
//     the interval between two readings of the estimator (item 6), the time in which the device can
//     have moved since the last reading, and the additional time for which the motors hold a
//     command if a tick is late. The differences are rounded to nanoseconds. In `running`, a device
//     state counts as new if its time stamp is finite and at least kLeastInterval ticks later than
//     that of the last new state, so no velocity is a quotient over less. After no_data_limit_s()
//     without a new device state, the fault kNoData is raised, or kRefusedState if states arrive
//     but are refused because of their contents. If a time stamp lies more than state_gap_max_s
//     after the previous one, kNoData is raised immediately. If late ticks are no fault (gap_max_s
//     is 0), the time that passed on this computer is added to state_gap_max_s, so that only a leap
//     of the device's clock is a fault. In all other states of the safety state machine, the
//     device's clock may restart, for example after the link was restored, or leap, for example
//     over a pause. The estimator then restarts too, and the reading is not compared with the one
//     before.
//  5. Some changes take a fixed number of ticks, so late ticks make these changes slower. They are
//     the ramp after a fault, the rise of two factors after a recovery (the factor on the force,
//     and the factor on the compensation of friction and weight), and the change from one
//     prefetched stiffness to the next.
//  6. A reading whose stamp is within a hundredth of a tick of a tick after the last one counts as
//     on time.
#pragma once

#include <cstdint>
#include <span>

#include "formats/session/faults.h"
#include "formats/session/recording.h"
#include "runtime/device/hand_device.h"
#include "runtime/haptics/estimator.h"
#include "runtime/haptics/force_law.h"
#include "runtime/haptics/loop/break_through.h"
#include "runtime/haptics/loop/guard.h"
#include "runtime/haptics/loop/passivity.h"
#include "runtime/haptics/loop/safety.h"

namespace trocar::runtime {

/// Shortest time between two device states that both count as new, in ticks. If time stamps are
/// off, a difference of two of them can be arbitrarily small.
inline constexpr double kLeastInterval = 0.2;

/// Parameters of the loop, constant during a session.
struct LoopModel {
  Tool tool;
  SafetyLimits limits;
  PoseEstimator estimator;  ///< ForceLaw::estimator()
  /// What the guard takes for noise (GuardInput).
  double band_m_per_s = 5e-3, band_rad_per_s = 0.1, way_m = 0, way_rad = 0;
  bool guards = true;  ///< false: neither the guard (guard.h) nor the damping after a break
  CompensationOptions compensation;  ///< compensation of friction and weight, in `running`
  double rate_Hz = 1000;
};

/// State of the loop that is kept between ticks. The force law keeps its own state (force_law.h).
struct LoopState {
  Pose T_device_plate;  ///< pose of the last tick whose checks passed
  EstimatedPose estimate;
  double estimate_interval_s = 0;  ///< contract 6; 0: the pose of this tick is not new
  SpeedState speed;
  GuardState guard;
  PassivityState passivity;
  BreakDamperState break_damper;
  BreakThroughState break_through;
  EnergyAccount energy;
  std::uint64_t tick = 0;  ///< number of ticks done
  /// Time between the previous new pose and the pose of this tick, on the device's clock; 0 if the
  /// pose of this tick is not new, or is the first pose. While no pose is new, the last velocity is
  /// kept, because a fall to 0 would make the force jump.
  double pose_interval_s = 0;
  /// Time on the device's clock minus the time of the counted ticks, since this difference was last
  /// set to 0. If the difference exceeds half a tick, it is added to the tick's length in the call
  /// of HandDevice::account_held_time(), and then set to 0.
  double ahead_s = 0;
  double host_s = 0;  ///< time on this computer since the last new reading
  Safety safety;
  double reading_t_s = 0;    ///< time stamp of the reading that keep_reading() kept last
  int no_data_ticks = 0;     ///< ticks since the last new reading
  bool has_reading = false;  ///< HandDevice::keep_reading() has kept a reading
  /// There was a kMotorOverload since the last `running`. Recovery then waits for
  /// HandDevice::check_rested(), also if an emergency stop has replaced the fault.
  bool must_rest = false;
};

struct TickResult {
  RecordingRow row;
  /// Result of the force law. The caller of haptic_tick() requests a hole for each
  /// element of contact.cuts().
  ContactOutput contact;
  BreakThroughTick break_through;
  DeviceReadout readout;
  /// The first fault found in this tick, with the measured value. If new_fault is set, `found`
  /// describes this fault. In `fault` and `recovering` only stops are latched (safety.h). Any other
  /// fault is not latched in these two states, but delays the recovery.
  FaultDetail found;
  /// Height by which the tip must be raised before `running` can begin
  /// (ForceLaw::retract_distance_m()).
  double retract_distance_m = 0;
  /// `device_ns`: time that this tick took to read, check and write the device. `law_ns`: time that
  /// this tick took to advance the safety state, compute the force and prepare the command.
  std::int64_t device_ns = 0, law_ns = 0;
  bool end_of_data = false;          ///< the replayed recording has ended, so there is no row
  Fault new_fault = Fault::kNone;    ///< fault latched in this tick
  bool guard_acted = false;          ///< the guard begins to soften the force further
  bool recovery_is_refused = false;  ///< RecoveryAnswer::kRefused
  bool torques_are_zero = false;     ///< the ramp after a fault has ended, so the force is zero
};

/// Inputs of a tick from other threads, the clock and the operator.
struct TickInputs {
  std::span<const Sheet* const> sheets;  ///< ForceLawInput::sheets
  PrefetchedStiffness prefetched;        ///< ForceLawInput::prefetched
  double gap_s = 0;                      ///< wall time since the previous tick started
  int missed_in_row = 0;                 ///< deadlines missed in a row right before this tick
  Fault outside = Fault::kNone;          ///< fault found by the caller, outside of the tick
  RecoveryRequest recover = RecoveryRequest::kNone;
};

/// Runs one tick: reads and checks the device, computes the wrench, lets the device render it, and
/// fills `result`.
void haptic_tick(const LoopModel& model, const TickInputs& inputs, HandDevice& device,
                 ForceLaw& law, LoopState& state, TickResult& result) noexcept;

}  // namespace trocar::runtime
