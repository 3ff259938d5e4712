// SPDX-License-Identifier: Apache-2.0
// A simulated hand. It holds the tool's tip through springs and dampers, in translation and
// rotation, and moves the other end of the springs along a trajectory. It consists of plain values
// and is evaluated on the haptic thread.
// Tests: tests/runtime/simulation/simulated_device_test.cpp
#pragma once

#include <cstdint>
#include <limits>
#include <vector>

#include "formats/base/result.h"
#include "runtime/mechanism/pose.h"

namespace trocar::runtime {

enum class HandInterpolation : std::uint8_t {
  kLinear,       ///< constant velocity between keyframes
  kMinimumJerk,  ///< at rest in every keyframe, 10 s^3 - 15 s^4 + 6 s^5 between them
};

struct HandKeyframe {
  double t_s = 0;
  Pose T_device_tool;  ///< target pose of the tool's tip
};

/// Before the first keyframe the hand rests at the first, after the last keyframe at the last.
/// Without keyframes there is no hand and no force.
struct HandTrajectory {
  std::vector<HandKeyframe> keyframes;  ///< strictly increasing t_s
  HandInterpolation interpolation = HandInterpolation::kLinear;
};

/// The impedance of a hand; the defaults are a firm grip. Contact with a wall of stiffness K
/// rendered at period T has no chatter while the damping exceeds K T / 2, which is 5 N s/m for 5
/// kN/m at 500 Hz.
struct HandImpedance {
  double stiffness_N_per_m = 4000;
  double damping_Ns_per_m = 100;
  double rotational_stiffness_Nm_per_rad = 20;
  double rotational_damping_Nms_per_rad = 0.3;
  /// Mass rigidly attached to the tool's tip. It has no weight, since the arm carries it.
  double mass_kg = 0;
  /// Time at which the hand releases the tool. There is no hand from then on.
  double let_go_t_s = std::numeric_limits<double>::infinity();
};

/// Two further grips. The values are assumed, within the ranges that the literature gives for
/// fingers and for a tensed arm.
constexpr HandImpedance light_grip() noexcept {
  return {300, 3, 2, 0.02, 0.05};
}
constexpr HandImpedance stiff_grip() noexcept {
  return {20000, 300, 60, 0.6, 0.5};
}

struct HandTarget {
  Pose T_device_tool;
  Twist twist_device = Twist::Zero();  ///< twist [v; omega] of the target tip, in {B}
};

/// The target at a time; the identity, at rest, if there is no keyframe. O(log keyframes), no
/// allocation.
HandTarget hand_target(const HandTrajectory& trajectory, double t_s) noexcept;

/// The hand's wrench [f; n] on the tool about the tip, in {B}.
Wrench hand_wrench(const HandImpedance& impedance, const HandTarget& target,
                   const Pose& T_device_tool, const Twist& twist_tool) noexcept;

/// Checks a hand. Errors: refused for times that do not increase, values that are not finite,
/// quaternions not of unit length, negative impedances or masses, and a release time that is not a
/// number.
Result<void> check_hand(const HandTrajectory& trajectory, const HandImpedance& impedance);

}  // namespace trocar::runtime
