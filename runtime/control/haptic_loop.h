// SPDX-License-Identifier: Apache-2.0
// One tick of the haptic loop, the same in real and in virtual time. In:
// the pose that a device measures. Out: the wrench that the device is to render, and one row of the recording. No
// allocation, lock or exception.
//
// Contract (tests/runtime/control/loop_test.cpp), in addition to the contracts of safety.h, limits.h,
// energy_limit.h and passivity.h:
//  1. Every command written was prepared by the device, within its limits (hand_device.h).
//  2. When a fault ends the state `running` (safety.h), the command follows the ramp of safety.h, which starts
//     from the last command written. If the fault is that a command could not be
//     written, the ramp starts in the next tick, from that command. Once the ramp has ended, and in `idle`, `ready` and `recovering`,
//     the force is zero.
//  3. The row holds every input of the tick, so replaying the rows gives the same commands.
//  4. All times are those of the device's clock. Differences of its time stamps, to the nanosecond, give the
//     intervals between poses, the velocities, how far a reading may differ from the last one, and for how long the motors
//     were heated in a late tick. In `running`, a device state is new if its time stamp is finite and later
//     than the previous one. After no_data_max_s without a new device state the fault is kNoData. If a time
//     stamp lies more than gap_max_s after the previous one, the fault is kNoData at once. (gap_max_s also limits the time
//     between ticks.) In all safety
//     states except `running`, the device's clock may restart, for example after the link was restored; the
//     velocity estimation restarts too.
//  5. The ramp after a fault, the rise of authority and compensation after a recovery, and the change from one prefetched
//     stiffness to the next take a number of ticks, so late ticks make them slower.
// Tests: tests/runtime/control/loop_test.cpp
#pragma once

#include <cstdint>
#include <span>

#include "formats/session/fault_words.h"
#include "formats/session/recording.h"
#include "runtime/contact/force_law.h"
#include "runtime/control/energy_limit.h"
#include "runtime/control/limits.h"
#include "runtime/control/passivity.h"
#include "runtime/control/safety.h"
#include "runtime/control/velocity_window.h"
#include "runtime/device/hand_device.h"

namespace trocar::runtime {

/// Parameters of the loop, constant during a session.
struct LoopModel {
  Tool tool;
  SafetyLimits limits;
  PassivityOptions passivity;        ///< not applied if the force law is passive
  CompensationOptions compensation;  ///< added to what the device renders, in `running` only
  double rate_Hz = 1000;
};

/// State of the loop that is kept between ticks. The force law keeps its own state (force_law.h).
struct LoopState {
  Pose T_device_plate;  ///< pose of the last tick whose checks passed
  VelocityWindow window;
  PreviousPose previous;  ///< earlier pose from which velocities are computed; without one they are
                          ///< computed from the last new pose
  SpeedState speed;
  PassivityState passivity;
  EnergyAccount energy;
  std::uint64_t tick = 0;  ///< number of ticks done
  /// Time between the previous new pose and the pose of this tick, on the device's clock. 0: the pose of this
  /// tick is not new, or it is the first one. While no pose is new, the last velocity is kept, so the next
  /// new pose causes no force spike.
  double pose_interval_s = 0;
  /// Device time beyond the ticks counted so far, which HandDevice::age() has not been told yet.
  double ahead_s = 0;
  Safety safety;
  double reading_t_s = 0;  ///< time of the last reading that was kept
  int no_data_ticks = 0;
  bool has_reading = false;  ///< a reading was kept
};

struct TickResult {
  RecordingRow row;
  ContactOutput
      contact;  ///< result of the force law; the caller requests a hole for each of its cuts()
  DeviceReadout readout;
  bool end_of_data = false;        ///< the replayed recording has ended, so there is no row
  Fault new_fault = Fault::kNone;  ///< fault latched in this tick
  /// The first fault found in this tick, with the measured value. If new_fault is set, `found` describes it.
  /// In `recovering` a fault is not latched, but it delays the recovery.
  FaultDetail found;
  /// ForceLaw::retract_distance_m(). While it is positive, `running` cannot begin.
  double retract_distance_m = 0;
  /// Times that the tick took: to read, check and write the device, and to compute the force.
  std::int64_t device_ns = 0, law_ns = 0;
  bool at_rest = false;  ///< the ramp after a fault has ended, so the force is zero
};

/// Inputs of a tick from other threads, the clock and the operator.
struct TickInputs {
  std::span<const Sheet* const> sheets;  ///< ForceLawInput::sheets
  PrefetchedStiffness prefetched;        ///< ForceLawInput::prefetched
  double gap_s = 0;                      ///< wall time since the previous tick started
  int missed_in_row = 0;                 ///< number of deadlines missed right before this tick
  Fault outside = Fault::kNone;          ///< fault found by the caller, outside of the tick
  bool recover = false;                  ///< the operator asks for recovery
};

/// Runs one tick: reads and checks the device, computes the wrench, lets the device render it, and fills `result`.
void haptic_tick(const LoopModel& model, const TickInputs& inputs, HandDevice& device,
                 ForceLaw& law, LoopState& state, TickResult& result) noexcept;

}  // namespace trocar::runtime
