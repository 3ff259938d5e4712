// SPDX-License-Identifier: Apache-2.0
// The safety state machine: five states, the events that lead from one to another, and the factor
// on the torques in each.
//
// Contract (tests/runtime/control/safety_test.cpp):
//  1. A fault in any state but `recovering` leads to `fault`, and the first fault is kept. Only a
//     request for recovery leaves that state.
//  2. From the tick that leaves `running`, torques are the last ones times a factor that falls
//     linearly to 0 in ramp_ticks() ticks and is below 1 in the first of them. At 250 Hz and more
//     that takes at most kRampMax_s; below, torques are zero at once. They are zero at once also
//     after kEnergyLimit: a ramp would continue to release energy to the hand.
//  3. `recovering` ends in `ready`, after `quiet_s` without a fault and with the tool in free
//     space; a fault starts that time again. Torques are zero meanwhile.
//  4. After a recovery the factor on the torques (`authority`) rises linearly from 0 to 1 over `ramp_up_s`.
//  5. A time of nan is safe: torques are zero at once, recovery never ends, and authority does not
//     rise. A negative time counts as zero.
#pragma once

#include <cstdint>

#include "formats/session/recording.h"

namespace trocar::runtime {

/// Longest time from the tick in which a fault is found to the one that writes zero torques.
inline constexpr double kRampMax_s = 0.004;

struct SafetyTiming {
  double ramp_s = kRampMax_s;  ///< item 2; not above kRampMax_s
  double quiet_s = 0.25;       ///< item 3
  double ramp_up_s = 0.25;     ///< item 4
};

enum class SafetyEvent : std::uint8_t {
  kSeen,     ///< the device's state was read and found good
  kFree,     ///< no fault, and the tool is in free space
  kFault,    ///< a fault was found
  kRecover,  ///< the operator asks for recovery
  kSettled,  ///< the time of item 3 is over
};
inline constexpr int kSafetyEvents = 5;

/// The table of transitions; an event without a transition leaves the state as it is.
SafetyState next_state(SafetyState state, SafetyEvent event) noexcept;

/// Memory between ticks.
struct Safety {
  SafetyState state = SafetyState::kIdle;
  Fault fault = Fault::kNone;  ///< latched; none outside of `fault` and `recovering`
  double fault_t_s = 0;
  std::uint64_t ramp_ticks_done = 0;  ///< since `running` was left
  std::uint64_t quiet_ticks = 0;      ///< item 3
  bool recovered = false;             ///< item 4 applies
  double authority = 1;               ///< item 4: factor on the torques while running
};

/// Ticks of the ramp of item 2, at least 1.
int ramp_ticks(const SafetyTiming& timing, double rate_Hz) noexcept;

/// Rise of the authority in a tick (item 4), at least 0; with 1 or more it rises at once.
double rise_per_tick(const SafetyTiming& timing, double rate_Hz) noexcept;

/// Reports a fault found at `t_s`. Returns whether this one is latched.
bool raise(Safety& safety, Fault fault, double t_s) noexcept;

/// Requests recovery. It takes effect, and true is returned, in `fault` once torques are zero.
bool recover(Safety& safety, const SafetyTiming& timing, double rate_Hz) noexcept;

/// Advances the machine by one tick. `fault`: what the tick's checks found, or none; `seen`: a
/// device state has been read; `free`: the tool is in free space.
void advance(Safety& safety, const SafetyTiming& timing, double rate_Hz, Fault fault, double t_s,
             bool seen, bool free) noexcept;

/// The factor of item 2 for this tick, on the torques at which `running` was left. Call it
/// once per tick outside of `running`.
double ramp_factor(Safety& safety, const SafetyTiming& timing, double rate_Hz) noexcept;

/// Whether the ramp after a fault has ended, so that torques are zero.
bool at_rest(const Safety& safety, const SafetyTiming& timing, double rate_Hz) noexcept;

}  // namespace trocar::runtime
