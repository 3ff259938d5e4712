// SPDX-License-Identifier: Apache-2.0
// Damps the plunge of the tool after a break. When the tip breaks through bone, nothing carries it
// any more, and the hand that pressed accelerates the plate into the gap. If the hand lets go at
// that moment, only the friction of the shaft stops the plate. The damper shortens this way. A hand
// that holds on hardly feels it: the damper takes a small part of the force that was lost.
//
// Contract (tests/runtime/control/break_damper_test.cpp):
//  1. The damper only takes energy from the plate. Its force acts at the tip along the shaft,
//     outwards, and only while the tip moves inwards.
//  2. Right after a break its coefficient is the lost force divided by kBreakSpeed_m_per_s. The
//     coefficient falls to 0 within kBreakDamping_s, at the square of the time since the break. A
//     later break can only raise it. It never exceeds
//     damping_max() (passivity.h), up to which a sampled damper is stable.
//  3. Without a break the damper has no force.
#pragma once

#include "runtime/contact/tool.h"
#include "runtime/control/passivity.h"
#include "runtime/device/pose.h"

namespace trocar::runtime {

/// The damper's force is the force that the break released, at this speed of the tip.
inline constexpr double kBreakSpeed_m_per_s = 1.5;
inline constexpr double kBreakDamping_s = 0.1;

/// Inputs of a tick.
struct BreakInput {
  Pose T_device_plate = {};
  /// Time since the previous new pose, on the device's clock; 0 if the pose is not new. The
  /// damper's force then stays as it is.
  double pose_interval_s = 0;
  PreviousPose previous =
      {};                   ///< start of the interval for the tip's velocity, if its age is not 0
  double lost_force_N = 0;  ///< ContactOutput::lost_force_N
};

/// State kept between ticks.
struct BreakDamperState {
  bool has_last = false;
  Pose T_device_plate;         ///< the last new pose
  double start_N_s_per_m = 0;  ///< coefficient right after the break
  double left_s = 0;           ///< time until the damper has faded
  double damping_N_s_per_m =
      0;               ///< coefficient of this tick; 0 while the tip does not move inwards
  double force_N = 0;  ///< force of this tick, along the shaft outwards
};

/// Returns the damper's wrench on the plate, in {B}.
Wrench damp_break(const PassivityOptions& options, double plate_mass_kg, const Tool& tool,
                  const BreakInput& input, BreakDamperState& state) noexcept;

}  // namespace trocar::runtime
