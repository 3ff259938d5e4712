// SPDX-License-Identifier: Apache-2.0
// All safety limits of the loop: on the plate's pose and speed, on released energy, and on times.
// If a limit is exceeded, the fault that belongs to this limit is raised, and the forces go to
// zero. This file has the checks of pose and speed. energy_limit.h has the check of energy, and
// haptic_loop.cpp has the checks of times. Each implementation of HandDevice checks the limits of
// the device's own parts. The haptic thread calls the check functions, which keep no state.
//
// Contract (limits_test.cpp in tests/runtime/control/):
//  1. A check returns kNone if no limit is exceeded. Otherwise it returns its fault with the
//     quantity, the quantity's value and the limit. A value that is not finite exceeds every limit.
//     A limit of nan is always exceeded. If a quantity cannot be negative, a negative limit is
//     always exceeded, too.
//  2. Before speeds are checked, they go through a first-order low-pass filter with the
//     time constant `speed_window_s`. Without the filter, a step of one encoder count could
//     look like a high speed.
#pragma once

#include <algorithm>
#include <array>

#include "formats/session/fault_words.h"
#include "formats/session/recording.h"
#include "runtime/control/safety.h"
#include "runtime/device/pose.h"

namespace trocar::runtime {

struct SafetyLimits {
  std::array<double, 3> workspace_min_m{-0.06, -0.06, 0.06};  ///< plate's origin, in {B}
  std::array<double, 3> workspace_max_m{0.06, 0.06, 0.24};
  double plate_tilt_max_rad = 0.6;          ///< angle between the plate's z axis and {B}'s
  double speed_max_m_per_s = 2;             ///< speed of the plate's origin
  double rotation_rate_max_rad_per_s = 40;  ///< rotation rate of the plate
  double speed_window_s = 0.004;            ///< time constant of the filter (item 2)
  /// Energy that the hand may receive within 0.1 s, in addition to the energy that was stored at
  /// the beginning of this time (energy_limit.h).
  double energy_limit_J = 0.05;
  /// Longest time without a new device state. During this time the loop uses the last state. If
  /// this value is positive but shorter than kNoDataTicks ticks, the limit is kNoDataTicks ticks
  /// (no_data_limit_s()).
  double no_data_max_s = 0.01;
  /// Longest time between the starts of two ticks. If gap_max_s is 0, neither this time nor missed
  /// deadlines are checked.
  double gap_max_s = 0.1;
  /// Longest time between two time stamps of the device (haptic_loop.h, contract 4).
  double state_gap_max_s = 0.1;
  int missed_deadlines_max = 2;  ///< missed deadlines allowed in a row; more are a fault
  SafetyTiming timing;
};

/// If SafetyLimits::no_data_max_s is positive, ticks without a new device state are a fault only if
/// there are at least this number in a row. A shorter series is no sign of a failure: if loop and
/// device have the same rate, now and then a tick finds no new state, and a packet may be lost.
inline constexpr double kNoDataTicks = 3;
/// Returns the longest time without a new device state at a rate of the loop. `no_data_max_s`:
/// SafetyLimits::no_data_max_s.
inline double no_data_limit_s(double no_data_max_s, double rate_Hz) noexcept {
  return no_data_max_s > 0 ? std::max(no_data_max_s, kNoDataTicks / rate_Hz) : no_data_max_s;
}

/// The plate's motion, kept between ticks.
struct SpeedState {
  bool has_pose = false;               ///< true if a pose is stored
  Pose T_device_plate;                 ///< the last pose that check_speed() was given
  Twist twist_device = Twist::Zero();  ///< filtered twist of the plate
};

/// Checks the position of the plate's origin and the plate's tilt. Returns kWorkspace or none.
FaultDetail check_workspace(const SafetyLimits& limits, const Pose& T_device_plate) noexcept;

/// Checks the plate's speed and rotation rate, and stores the pose in `state`. Returns kSpeed or
/// none. `dt_s`: time since the stored pose, on the device's clock. If no pose is stored, the plate
/// is assumed to be at rest.
FaultDetail check_speed(const SafetyLimits& limits, const Pose& T_device_plate, double dt_s,
                        SpeedState& state) noexcept;

}  // namespace trocar::runtime
