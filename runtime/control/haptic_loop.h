// SPDX-License-Identifier: Apache-2.0
// One tick of the haptic loop, the same in real and in virtual time: encoder angles in, torques and one row
// of the recording out. No allocation, lock or exception.
//
// Contract (tests/runtime/control/loop_test.cpp), in addition to the contracts of safety.h, limits.h,
// energy_limit.h and passivity.h:
//  1. Every torque written is finite and within what its motor's thermal state allows.
//  2. When a fault ends `running`, torques follow the ramp of safety.h, which starts from the last torques
//     written. If writing failed, the ramp starts one tick later, from the torques that could not be written.
//     In all other states torques are zero.
//  3. The row holds every input of the tick: replaying the rows gives the same torques.
//  4. Time is the device's. Intervals between poses, velocities, the largest step of an encoder and the
//     motor heat of a late tick are computed from differences of the device's time stamps, to the
//     nanosecond. A state whose time is not finite, or not later than the previous one's, is not new. After
//     no_data_max_s without a new state the fault is kNoData. If a time stamp lies more than gap_max_s after
//     the previous one, the fault is kNoData at once. While forces are not rendered, the device's clock may
//     restart, for example after the link was restored; velocity estimation then restarts as well.
//  5. The rise of torques, the ramps and the blending of stiffnesses count ticks: late ticks make them
//     slower, never faster.
// Tests: tests/runtime/control/loop_test.cpp
#pragma once

#include <cstdint>
#include <span>

#include "formats/session/device_description.h"
#include "formats/session/fault_words.h"
#include "formats/session/recording.h"
#include "runtime/contact/force_law.h"
#include "runtime/control/energy_limit.h"
#include "runtime/control/limits.h"
#include "runtime/control/passivity.h"
#include "runtime/control/safety.h"
#include "runtime/control/velocity_window.h"
#include "runtime/device/device.h"
#include "runtime/mechanism/motor.h"
#include "runtime/mechanism/torque_allocation.h"

namespace trocar::runtime {

/// Constant during a session.
struct LoopModel {
  DeviceDescription device;
  Tool tool;
  SafetyLimits limits;
  PassivityOptions passivity;        ///< ignored by force laws that are passive
  CompensationOptions compensation;  ///< added to the rendered torques, in `running` only
  double rate_Hz = 1000;
};

/// The loop's memory between ticks. The force law keeps its own (force_law.h).
struct LoopState {
  Pose T_device_plate;                                ///< pose of the last tick whose checks passed
  Jacobian G = Jacobian::Zero();                      ///< Jacobian at T_device_plate
  MotorVector tau_motor_Nm = MotorVector::Zero();     ///< torques last written
  MotorVector tau_at_stop_Nm = MotorVector::Zero();   ///< torques when `running` ended
  MotorVector compensation_Nm = MotorVector::Zero();  ///< compensation contained in tau_motor_Nm
  VelocityWindow window;
  PreviousPose
      previous;  ///< pose from which velocities are computed; if absent: pose_interval_s is used
  LimitState limits;
  PassivityState passivity;
  EnergyAccount energy;
  std::uint64_t tick = 0;  ///< number of ticks done
  /// Time between the previous new pose and this tick's, on the device's clock; 0: no new pose in this
  /// tick, or the first one. Without a new pose the last velocity (dx') is held, and the next pose causes
  /// no force spike.
  double pose_interval_s = 0;
  /// Device time that has passed beyond the counted ticks; the motors' heating in it is still to be added.
  double ahead_s = 0;
  double compensation_authority = 0;  ///< factor on the compensation; rises like Safety::authority
  Safety safety;
  DeviceState device;  ///< last state read whose angles are finite
  int no_data_ticks = 0;
  bool has_state = false;  ///< `device` has been read
};

struct TickResult {
  RecordingRow row;
  ContactOutput contact;  ///< result of the force law in this tick; its cuts() are to be requested
  bool end_of_data = false;        ///< the recording that is replayed has ended: no row
  Fault new_fault = Fault::kNone;  ///< fault latched in this tick
  /// The first fault that this tick found, with the measured value; it describes new_fault if there is one.
  /// In `recovering` a fault is not latched, but prevents the recovery.
  FaultDetail found;
  /// ForceLaw::retract_distance_m(); above 0 it prevents `running` from beginning.
  double retract_distance_m = 0;
  bool at_rest = false;  ///< the ramp after a fault has ended: torques are zero
};

/// Inputs of a tick from other threads, the clock and the operator.
struct TickInputs {
  std::span<const Sheet* const> sheets;  ///< ForceLawInput::sheets
  PrefetchedStiffness prefetched;        ///< ForceLawInput::prefetched
  double gap_s = 0;                      ///< wall time since the previous tick started
  int missed_in_row = 0;                 ///< number of deadlines missed right before this tick
  Fault outside = Fault::kNone;          ///< fault that the caller found
  bool recover = false;                  ///< the operator asks for recovery
};

/// Runs one tick: reads the device, checks, computes and writes torques; fills `result`.
void haptic_tick(const LoopModel& model, const TickInputs& inputs, Device& device, ForceLaw& law,
                 LoopState& state, TickResult& result) noexcept;

}  // namespace trocar::runtime
