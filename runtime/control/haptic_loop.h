// SPDX-License-Identifier: Apache-2.0
// One tick of the haptic loop, the same in real and in virtual time: encoder angles in, torques and
// one row of the recording out. No allocation, lock or exception.
//
// Contract (tests/runtime/control/loop_test.cpp), in addition to safety.h, limits.h,
// energy_limit.h, passivity.h:
//  1. Every torque written is finite and within what its motor's thermal state allows.
//  2. When `running` is left because of a fault, torques follow the ramp of safety.h, which starts
//     from the last torques written. If the write itself failed it starts from the torques of that
//     write, one tick later. In all other states torques are zero.
//  3. The row holds every input of the tick: replaying the rows gives the same torques.
//  4. Time is the device's: intervals between poses, and with them velocities, the largest step of
//     an encoder and the heat of a tick that came late, are differences of its states' times, to
//     the nanosecond. A state whose time is not finite, or not after the last one's, is not new:
//     after no_data_max_s without a new one the fault is kNoData. So it is at once if the time is
//     more than gap_max_s after the last one's. While forces are not rendered the device's clock
//     may also start again, as after a restored link; velocities then start again too.
//  5. A torque's rise, the ramps and the blending of responses count ticks: late ticks make them
//     slower, never faster.
#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include "formats/session/device_description.h"
#include "formats/session/fault_words.h"
#include "formats/session/recording.h"
#include "runtime/contact/puncture.h"
#include "runtime/control/energy_limit.h"
#include "runtime/control/limits.h"
#include "runtime/control/passivity.h"
#include "runtime/control/safety.h"
#include "runtime/control/velocity_window.h"
#include "runtime/control/virtual_coupling.h"
#include "runtime/cutting/body_contact.h"
#include "runtime/device/device.h"
#include "runtime/mechanism/motor.h"
#include "runtime/mechanism/torque_allocation.h"

namespace trocar::runtime {

/// Constant through a session.
struct LoopModel {
  DeviceDescription device;
  ContactModel contact;
  SafetyLimits limits;
  PassivityOptions passivity;
  CouplingOptions coupling;
  CompensationOptions compensation;  ///< added to the rendered torques, in `running` only
  double rate_Hz = 1000;
  /// Force law `cutting`: with the coupling as the device allows (device_coupling.h), else null.
  /// Sheets, tissues, `coupling` and `passivity` are for the other laws.
  std::shared_ptr<const Body> body;
  bool predicts = false;   ///< `body`: evaluated at the pose a tick ahead
  double force_scale = 1;  ///< `body`: the plate gets this times the tissue's wrench
};

/// The haptic thread's memory between ticks.
struct LoopState {
  Pose T_device_plate;                                ///< of the last tick whose checks passed
  Jacobian G = Jacobian::Zero();                      ///< at T_device_plate
  MotorVector tau_motor_Nm = MotorVector::Zero();     ///< last written
  MotorVector tau_at_stop_Nm = MotorVector::Zero();   ///< when `running` was left
  MotorVector compensation_Nm = MotorVector::Zero();  ///< part of tau_motor_Nm
  ContactState contact;
  BodyState body;  ///< make_body_state() of LoopModel::body
  VelocityWindow window;
  EarlierPose earlier;  ///< velocities are computed over the time since; none: over pose_interval_s
  LimitState limits;
  PassivityState passivity;
  EnergyAccount energy;
  CouplingState coupling;
  std::uint64_t tick = 0;  ///< ticks done
  /// Time between the previous new pose and this tick's, on the device's clock; 0: no new pose in
  /// this tick, or the first one. Without a new pose the last velocity (dx') is held, and the next
  /// pose causes no force spike.
  double pose_interval_s = 0;
  double ahead_s = 0;  ///< time on the device's clock beyond that of the ticks, not counted yet
  double compensation_share = 0;  ///< rises like Safety::authority
  Safety safety;
  DeviceState device;  ///< the last one read whose angles are finite
  int no_data_ticks = 0;
  bool has_state = false;  ///< `device` has been read
};

struct TickResult {
  RecordingRow row;
  ContactOutput contact;           ///< of this tick; after a puncture its `cut` is to be requested
  bool end_of_data = false;        ///< the recording that is replayed has ended: no row
  Fault new_fault = Fault::kNone;  ///< latched in this tick
  /// The first fault that this tick found, with what was measured; of new_fault if there is one. In
  /// `recovering` a fault is not latched, but prevents the recovery.
  FaultDetail found;
  /// How far the tool is below the top of the sheets that would press on it; 0: in free space.
  /// Above 0 it prevents `running` from beginning.
  double lift_m = 0;
  bool at_rest = false;  ///< the ramp after a fault has ended: torques are zero
};

/// Inputs of a tick from other threads, the clock and the operator.
struct TickInputs {
  std::span<const Sheet* const> sheets;  ///< as in update_contact
  SheetResponse response;                ///< as in update_contact
  double gap_s = 0;                      ///< wall time since the previous tick started
  int missed_in_row = 0;                 ///< deadlines missed right before this tick
  Fault outside = Fault::kNone;          ///< a fault that the caller found
  bool recover = false;                  ///< the operator asks for recovery
};

/// Runs one tick: reads the device, checks, computes and writes torques; fills `result`.
void haptic_tick(const LoopModel& model, const TickInputs& inputs, Device& device, LoopState& state,
                 TickResult& result) noexcept;

}  // namespace trocar::runtime
