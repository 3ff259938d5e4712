// SPDX-License-Identifier: Apache-2.0
// One tick of the haptic loop, the same in real and in virtual time: encoders in,
// torques out, and a row that says what happened. No allocation, lock or exception.
//
// Safety laws (tests/loop_test.cpp):
//  1. A fault latches: it is the first one that is kept, and only a new LoopState ends it.
//  2. From the faulty tick on (from the next one, if the write itself failed), torques are the
//     last good ones times a factor that falls linearly from less than 1 to 0 over `ramp_s`.
//  3. No torque that is not finite, or beyond the motors' peak, is ever written.
//  4. Torques rise no faster than `torque_rise_max_Nm_per_s`: the step from the last torques is
//     shortened as a whole, never motor by motor. Where no motor's torque grows beyond the
//     largest one before, as when a sheet gives way, nothing is shortened.
#pragma once

#include <cstdint>
#include <span>

#include "formats/device_description.h"
#include "formats/recording.h"
#include "runtime/contact/puncture.h"
#include "runtime/device/device.h"
#include "runtime/device/torque_allocation.h"

namespace trocar::runtime {

struct SafetyLimits {
  double encoder_rate_max_rad_per_s = 60;  ///< of any encoder between two ticks
  double pose_residual_max_m = 1e-3;       ///< of the pose's fit to the upper chains
  double theta4_residual_max_rad = 0.02;   ///< measured against that of the fitted pose
  double inverse_condition_min = 0.02;     ///< of the Jacobian, at 0.05 m
  double torque_rise_max_Nm_per_s = 5000;
  int no_data_ticks_max = 3;  ///< in a row, on the last state; more are a fault
  double gap_max_s = 0.1;     ///< between two ticks' starts; 0: no limit
  double ramp_s = 0.05;       ///< law 2
};

/// What stays the same through a session.
struct LoopModel {
  DeviceDescription device;
  ContactModel contact;
  SafetyLimits limits;
  double rate_Hz = 1000;
};

/// The haptic thread's memory between ticks.
struct LoopState {
  std::uint64_t tick = 0;  ///< ticks done
  ContactState contact;
  bool has_state = false;  ///< a device state has been read
  DeviceState device;      ///< the last one read
  int no_data_ticks = 0;
  Pose T_device_plate;                             ///< of the last good tick
  Jacobian G = Jacobian::Zero();                   ///< likewise
  MotorVector tau_motor_Nm = MotorVector::Zero();  ///< last written
  Fault fault = Fault::kNone;
  double fault_t_s = 0;
  MotorVector tau_at_fault_Nm = MotorVector::Zero();
  std::uint64_t ramp_ticks_done = 0;
};

struct TickResult {
  RecordingRow row;
  ContactOutput contact;     ///< of this tick; `gave_way` asks for a cut
  bool end_of_data = false;  ///< the device (a recording) is at its end: no row
  bool ramp_done = false;    ///< a fault's ramp has ended: torques are zero
};

/// What other threads have for this tick.
struct TickInputs {
  std::span<const Sheet* const> sheets;  ///< as in update_contact
  SheetResponse response;                ///< likewise
  double gap_s = 0;                      ///< wall time since the last tick's start
};

/// One tick.
void haptic_tick(const LoopModel& model, const TickInputs& inputs, Device& device, LoopState& state,
                 TickResult& result) noexcept;

/// Law 4. Returns the torques and, in `shortened`, whether they differ from `wanted`.
MotorVector limit_rise(const MotorVector& last, const MotorVector& wanted, double rise_max_Nm,
                       bool& shortened) noexcept;

}  // namespace trocar::runtime
