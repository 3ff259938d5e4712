// SPDX-License-Identifier: Apache-2.0
// One tick of the haptic loop, the same in real and in virtual time: encoders in,
// torques out, and a row that says what happened. No allocation, lock or exception.
//
// Laws (tests/runtime/control/loop_test.cpp), beside those of safety.h, limits.h, passivity.h:
//  1. No torque that is not finite, or beyond what its motor's heat allows, is ever written.
//  2. Outside of `running` torques are the ramp of safety.h from those it was left with (a write
//     that fails: from those it failed to write, one tick later), else zero.
//  3. The row holds all that the torques depend on: the same rows give the same torques.
#pragma once

#include <cstdint>
#include <span>

#include "formats/session/device_description.h"
#include "formats/session/recording.h"
#include "runtime/contact/puncture.h"
#include "runtime/device/device.h"
#include "runtime/mechanism/motor.h"
#include "runtime/mechanism/torque_allocation.h"
#include "runtime/control/limits.h"
#include "runtime/control/passivity.h"
#include "runtime/control/safety.h"
#include "runtime/control/virtual_coupling.h"

namespace trocar::runtime {

/// What stays the same through a session.
struct LoopModel {
  DeviceDescription device;
  ContactModel contact;
  SafetyLimits limits;
  PassivityOptions passivity;
  CouplingOptions coupling;
  CompensationOptions compensation;  ///< beside the rendered torques, while `running` only
  double rate_Hz = 1000;
};

/// The haptic thread's memory between ticks.
struct LoopState {
  std::uint64_t tick = 0;  ///< ticks done
  ContactState contact;
  DeviceState device;  ///< the last one read whose angles are finite
  /// The time in which T_device_plate came about since the last new pose; 0: a tick without data,
  /// on the last one. Every rate is over this: what was missed is no blow, and silence no stop.
  double moved_over_s = 0;
  Pose T_device_plate;                               ///< of the last good tick
  Jacobian G = Jacobian::Zero();                     ///< likewise
  MotorVector tau_motor_Nm = MotorVector::Zero();    ///< last written
  MotorVector tau_at_stop_Nm = MotorVector::Zero();  ///< when `running` was left
  MotorVector beside_Nm = MotorVector::Zero();       ///< compensation in tau_motor_Nm
  double compensation_share = 0;                     ///< rises as Safety::authority does
  Safety safety;
  LimitState limits;
  PassivityState passivity;
  CouplingState coupling;
  int no_data_ticks = 0;
  bool has_state = false;  ///< `device` has been read
};

struct TickResult {
  RecordingRow row;
  ContactOutput contact;           ///< of this tick; `gave_way` asks for a cut
  bool end_of_data = false;        ///< the device (a recording) is at its end: no row
  Fault new_fault = Fault::kNone;  ///< latched in this tick
  bool at_rest = false;            ///< a fault's ramp has ended: torques are zero
};

/// What other threads, the clock and the operator have for this tick.
struct TickInputs {
  std::span<const Sheet* const> sheets;  ///< as in update_contact
  SheetResponse response;                ///< likewise
  double gap_s = 0;                      ///< wall time since the last tick's start
  int missed_in_row = 0;                 ///< deadlines missed right before this tick
  Fault outside = Fault::kNone;          ///< what the caller found
  bool recover = false;                  ///< the operator asks for recovery
};

/// One tick.
void haptic_tick(const LoopModel& model, const TickInputs& inputs, Device& device, LoopState& state,
                 TickResult& result) noexcept;

}  // namespace trocar::runtime
