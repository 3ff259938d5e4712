// SPDX-License-Identifier: Apache-2.0
// Damps the plunge of the tool after a break. When the tip breaks through bone, nothing supports
// the tip any more, and the hand that pressed accelerates the plate inwards. If the hand lets go at
// that moment, only the friction of the shaft stops the plate. With the damper the plate stops
// sooner. A hand that holds on hardly feels the damper, because the damper's force is then a small
// part of the force that was lost.
//
// Contract (tests/runtime/control/break_damper_test.cpp):
//  1. The damper's force acts at the tip along the shaft, outwards. It tends to a target that is
//     not 0 only while the measured velocity of the tip points inwards. The velocity is a mean over
//     the interval that `previous` gives. While the tip moves inwards, the force takes energy from
//     the plate. The force can give energy to the plate only after the tip has turned back. This
//     lasts at most as long as the interval, plus the time until the next new pose, plus the ticks
//     in which the force falls (item 3).
//  2. Right after a break the damping coefficient is the lost force divided by
//     kBreakSpeed_m_per_s. At the time t after the break this value is multiplied by
//     1 - (t / kBreakDamping_s)^2, so it is 0 after kBreakDamping_s. A later break starts this
//     course anew if that raises the coefficient; otherwise it changes nothing. The damper never
//     uses a coefficient above damping_max() (passivity.h), up to which a sampled damper is stable.
//  3. Whatever the poses and their times are: from tick to tick the force changes by at most
//     kBreakStep times the lost force, and the force never exceeds the lost force. A velocity above
//     kBreakSpeed_m_per_s therefore counts as this one.
//  4. Without a break the damper has no force.
#pragma once

#include "runtime/contact/tool.h"
#include "runtime/control/passivity.h"
#include "runtime/device/pose.h"

namespace trocar::runtime {

/// Speed of the tip at which the damper's force right after a break equals the lost force.
inline constexpr double kBreakSpeed_m_per_s = 1.5;
inline constexpr double kBreakDamping_s = 0.1;
/// Largest change of the damper's force in a tick, as a part of the lost force. At 100 Hz a change
/// of this size is that of a plate which is accelerated by 30 m/s^2, more than a hand can do.
inline constexpr double kBreakStep = 0.2;

/// Inputs of a tick.
struct BreakInput {
  Pose T_device_plate = {};
  /// Time since the previous new pose, on the device's clock; 0 if the pose is not new. The target
  /// of the damper's force then stays as it is.
  double pose_interval_s = 0;
  /// Start of the interval for the tip's velocity; age 0: the interval starts at the
  /// previous new pose.
  PreviousPose previous = {};
  double lost_force_N = 0;  ///< ContactOutput::lost_force_N
};

/// State kept between ticks.
struct BreakDamperState {
  bool has_last = false;
  Pose T_device_plate;         ///< the last new pose
  double start_N_s_per_m = 0;  ///< coefficient right after the break
  double left_s = 0;           ///< time until the coefficient is 0
  double target_N = 0;         ///< force that the last new pose asks for
  double force_N = 0;          ///< force of this tick, along the shaft outwards
};

/// Returns the damper's wrench on the plate, in {B}.
Wrench damp_break(const PassivityOptions& options, double plate_mass_kg, const Tool& tool,
                  const BreakInput& input, BreakDamperState& state) noexcept;

}  // namespace trocar::runtime
