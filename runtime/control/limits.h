// SPDX-License-Identifier: Apache-2.0
// Safety limits of the plate's pose and speed, of the energy, and of times. When a limit is exceeded, a named fault stops the
// loop. The haptic thread calls these functions. They keep no state of their own. The limits of a device's own parts are checked
// by its implementation of HandDevice.
//
// Contract (limits_test.cpp in tests/runtime/control/):
//  1. A check returns kNone if its limit is not exceeded, and otherwise its own fault, with the
//     quantity, the quantity's value and the limit. A value that is not finite exceeds every
//     limit. A limit of nan is always exceeded, and so is a negative limit of a quantity that
//     cannot be negative.
//  2. Speeds go through a first-order low-pass filter with the time constant `speed_window_s`, so that a step of one encoder
//     count does not appear as a speed.
#pragma once

#include <array>

#include "formats/session/fault_words.h"
#include "formats/session/recording.h"
#include "runtime/control/safety.h"
#include "runtime/device/pose.h"

namespace trocar::runtime {

struct SafetyLimits {
  std::array<double, 3> workspace_min_m{-0.06, -0.06, 0.06};  ///< bounds of the plate's origin
  std::array<double, 3> workspace_max_m{0.06, 0.06, 0.24};
  double plate_tilt_max_rad = 0.6;          ///< angle between the plate's z axis and {B}'s
  double speed_max_m_per_s = 2;             ///< speed of the plate's origin
  double rotation_rate_max_rad_per_s = 40;  ///< rotation rate of the plate
  double speed_window_s = 0.004;            ///< time constant of item 2
  /// Energy that the hand may receive within 0.1 s in addition to the energy that was stored (energy_limit.h).
  double energy_limit_J = 0.05;
  /// Longest time without data from the device. Until it is exceeded, the loop uses the last device state.
  double no_data_max_s = 0.01;
  /// Longest time between the starts of two ticks, and between two time stamps of the device. If
  /// gap_max_s is 0, neither these two times nor missed deadlines are checked.
  double gap_max_s = 0.1;
  int missed_deadlines_max = 2;  ///< number allowed in a row; more are a fault
  SafetyTiming timing;
};

/// The plate's motion, kept between ticks.
struct SpeedState {
  bool has_pose = false;
  Pose T_device_plate;  ///< pose of the last tick
  Twist twist_device = Twist::Zero();
};

/// Returns kWorkspace or none.
FaultDetail check_workspace(const SafetyLimits& limits, const Pose& T_device_plate) noexcept;

/// Returns kSpeed or none, and stores the pose. `dt_s`: time since the last pose, on the device's clock. If has_pose is false,
/// the plate is assumed to be at rest.
FaultDetail check_speed(const SafetyLimits& limits, const Pose& T_device_plate, double dt_s,
                        SpeedState& state) noexcept;

}  // namespace trocar::runtime
