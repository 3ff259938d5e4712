// SPDX-License-Identifier: Apache-2.0
// The loop's safety: state machine and limits.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>

#include "formats/session/faults.h"
#include "formats/session/recording.h"
#include "runtime/device/device.h"

namespace trocar::runtime {

// The safety state machine. It has five states (idle, ready, running, fault, recovering), events
// that lead from one state to another, and factors on the force and on the torques.
//
// Contract:
//  1. A fault in any state but `recovering` leads to `fault`, and the first fault is kept. Only
//     answer_request() leaves the state `fault`, so no other way leads to `recovering` or back to
//     `running`. A stop (faults.h) leads to `fault` from every state. A newly pressed emergency
//     stop replaces the fault that was kept, also in the state `fault`; pause and zero forces
//     replace it in `recovering` only.
//  2. When a fault ends `running`, torques are ramped down, beginning in the tick in which the
//     fault is found: the last torques are multiplied by a factor that falls linearly to 0 in
//     ramp_ticks() ticks. The factor is below 1 already in the first of these ticks. The ramp takes
//     at most kRampMax_s. Below 500 Hz, torques are zero in the tick that finds the fault.
//     After kEnergyLimit torques are also zero immediately, because a ramp would continue to
//     release energy to the hand.
//  3. The state `recovering` changes to `ready` when, for the time `quiet_s`, there was no fault
//     and the tool was in free space. A fault or a contact of the tool restarts this time. In
//     `recovering`, torques are zero.
//  4. In the state `running` after a recovery, the factor on the force (`authority`) rises linearly
//     from 0 to 1 over `ramp_up_s`. If `ramps_at_start` is set, the factor rises in the same way at
//     the beginning of a session.
//  5. A time of SafetyTiming that is nan has a safe result. If `ramp_s` is nan, torques are zero
//     immediately. If `quiet_s` is nan, the state `recovering` never ends. If `ramp_up_s` is nan,
//     the authority does not rise. A negative time is treated as zero.
//  6. While a stop is held, the state is `fault`, and a request for recovery is refused: it is not
//     kept. A request is also refused in the tick in which the loop first sees that the device's
//     stop was released. So `running` begins only after a request that is newer than the release of
//     every stop, as the loop saw them. An automatic request has no effect if a stop is held or
//     latched.

/// Longest time from the tick in which a fault is found to the tick that writes zero torques.
inline constexpr double kRampMax_s = 0.004;

struct SafetyTiming {
  double ramp_s = kRampMax_s;   ///< duration of the ramp of item 2, at most kRampMax_s
  double quiet_s = 0.25;        ///< time without fault and contact (item 3)
  double ramp_up_s = 0.25;      ///< rise time of the authority (item 4)
  bool ramps_at_start = false;  ///< item 4 applies to the beginning of a session, too
};

enum class SafetyEvent : std::uint8_t {
  kSeen,     ///< the device was read, and no check found a fault
  kFree,     ///< no fault, and the tool is in free space
  kFault,    ///< a failed check
  kRecover,  ///< a request for recovery takes effect
  kSettled,  ///< the time `quiet_s` of item 3 has passed
  kStop,     ///< a stop is held
};
inline constexpr int kSafetyEvents = 6;

/// Returns the state that follows an event. An event without a transition keeps the state.
SafetyState next_state(SafetyState state, SafetyEvent event) noexcept;

/// State kept between ticks.
struct Safety {
  SafetyState state = SafetyState::kIdle;
  Fault fault = Fault::kNone;         ///< latched fault; none except in `fault` and `recovering`
  double fault_t_s = 0;               ///< time at which `fault` was latched
  std::uint64_t faults = 0;           ///< number of faults that were latched
  std::uint64_t ramp_ticks_done = 0;  ///< ticks since `running` ended; 1'000'000 or more: no ramp
  std::uint64_t quiet_ticks = 0;      ///< ticks that count towards `quiet_s` (item 3)
  HeldStops stops;                    ///< stops as the loop last saw them
  bool waits_for_ramp = false;        ///< a request takes effect once torques are zero
  bool recovered = false;             ///< the next `running` begins with authority 0 (item 4)
  double authority = 1;               ///< factor on the force in `running` (item 4)
};

/// Number of ticks of the ramp of item 2, at least 1.
int ramp_ticks(const SafetyTiming& timing, double rate_Hz) noexcept;

/// Rise of the authority in a tick (item 4), at least 0. A rise of 1 or more makes the authority 1
/// within one tick.
double rise_per_tick(const SafetyTiming& timing, double rate_Hz) noexcept;

/// Enters the state that follows a fault found at `t_s`. Returns true if this fault is latched.
/// advance() calls raise() for the fault that it is given; the caller must call raise() for a fault
/// that it finds later in the tick.
bool raise(Safety& safety, Fault fault, double t_s) noexcept;

/// Takes the stops of a tick, in each tick before answer_request(): the arguments of
/// HeldStops::take(). take_written() takes the status of the tick's write.
void take_stops(Safety& safety, DeviceStatus read, Fault outside, double t_s) noexcept;
void take_written(Safety& safety, DeviceStatus written, double t_s) noexcept;

enum class RecoveryRequest : std::uint8_t {
  kNone,
  kByOperator,
  kAutomatic,  ///< by RecoveryPolicy::kAuto; it never resets a stop
};
enum class RecoveryAnswer : std::uint8_t {
  kNone,     ///< nothing was requested, or an automatic request has no effect
  kTaken,    ///< the request counts; in other states than `fault` it has no effect
  kRefused,  ///< item 6: the operator must ask again
};
/// Answers this tick's request. The state becomes `recovering` if a request was taken in the state
/// `fault` and torques are zero; until they are, the request waits, unless a fault is latched
/// meanwhile. Call this once in each tick, also without a request.
RecoveryAnswer answer_request(Safety& safety, RecoveryRequest request, const SafetyTiming& timing,
                              double rate_Hz) noexcept;

/// Advances the machine by one tick. `fault`: fault found by the tick's checks, or none. `t_s`:
/// time of the tick. `seen`: a state of the device was read in this tick or earlier. `free`: the
/// tool is in free space.
void advance(Safety& safety, const SafetyTiming& timing, double rate_Hz, Fault fault, double t_s,
             bool seen, bool free) noexcept;

/// Returns the factor of item 2 for this tick. The caller multiplies the last torques of `running`
/// by this factor. Call this once in each tick in which the state is not `running`.
double ramp_factor(Safety& safety, const SafetyTiming& timing, double rate_Hz) noexcept;

/// Returns true in the state `fault` once the ramp has ended, so that torques are zero.
bool torques_are_zero(const Safety& safety, const SafetyTiming& timing, double rate_Hz) noexcept;

// All safety limits of the loop: on the plate's pose and speed, on released energy, and on times.
// If a limit is exceeded, the fault that belongs to this limit is raised, and the forces go to
// zero. This file has the checks of pose and speed. passivity.h has the check of energy, and
// haptic_loop.cpp has the checks of times. Each implementation of HandDevice checks the limits of
// the device's own parts. The haptic thread calls the check functions, which keep no state.
//
// Contract:
//  1. A check returns kNone if no limit is exceeded. Otherwise it returns its fault with the
//     quantity, the quantity's value and the limit. A value that is not finite exceeds every limit.
//     A limit of nan is always exceeded. If a quantity cannot be negative, a negative limit is
//     always exceeded, too.
//  2. Before speeds are checked, they go through a first-order low-pass filter with the
//     time constant `speed_window_s`. Without the filter, a step of one encoder count could
//     look like a high speed.

struct SafetyLimits {
  std::array<double, 3> workspace_min_m{-0.06, -0.06, 0.06};  ///< plate's origin, in {B}
  std::array<double, 3> workspace_max_m{0.06, 0.06, 0.24};
  double plate_tilt_max_rad = 0.6;          ///< angle between the plate's z axis and {B}'s
  double speed_max_m_per_s = 2;             ///< speed of the plate's origin
  double rotation_rate_max_rad_per_s = 40;  ///< rotation rate of the plate
  double speed_window_s = 0.004;            ///< time constant of the filter (item 2)
  /// Energy that the hand may receive within 0.1 s, in addition to the energy that was stored at
  /// the beginning of this time (passivity.h).
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
