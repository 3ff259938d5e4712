// SPDX-License-Identifier: Apache-2.0
// What the loop is allowed to do: five states, the events that lead from one to another, and the
// share of the torques that goes with them.
//
// Laws (tests/runtime/control/safety_test.cpp):
//  1. Any fault, in any state but recovering, leads to `fault`, and it is the first one that is
//     kept; nothing but a request for recovery leaves that state.
//  2. From the tick that leaves `running` on, torques are the last ones times a factor that falls
//     linearly from less than 1 to 0 in ramp_ticks() ticks: within kRampMax_s at
//     250 Hz and more, at once below.
//  3. From `recovering` the way leads through `ready` only, after a time without any fault with
//     the tool in free space; a fault in between starts that time anew. Torques are zero.
//  4. After a recovery the share of the torques rises linearly from 0 to 1 over `ramp_up_s`.
//  5. A time that is nan permits nothing: torques are zero at once, recovery never ends, and no
//     share rises. A negative time is zero.
#pragma once

#include <cstdint>

#include "formats/session/recording.h"

namespace trocar::runtime {

/// From the tick in which a fault is found to the one that writes zero torques.
inline constexpr double kRampMax_s = 0.004;

struct SafetyTiming {
  double ramp_s = kRampMax_s;  ///< law 2; not above kRampMax_s
  double quiet_s = 0.25;       ///< law 3
  double ramp_up_s = 0.25;     ///< law 4
};

enum class SafetyEvent : std::uint8_t {
  kSeen,     ///< the device's state was read and found good
  kFree,     ///< all is well and the tool is where no sheet bears it
  kFault,    ///< something is wrong
  kRecover,  ///< the operator asks for recovery
  kSettled,  ///< law 3's time is over
};
inline constexpr int kSafetyEvents = 5;

/// The table of transitions; an event that means nothing in a state leaves it as it is.
SafetyState next_state(SafetyState state, SafetyEvent event) noexcept;

/// Between ticks.
struct Safety {
  SafetyState state = SafetyState::kIdle;
  Fault fault = Fault::kNone;  ///< latched; none outside of `fault` and `recovering`
  double fault_t_s = 0;
  std::uint64_t ramp_ticks_done = 0;  ///< since `running` was left
  std::uint64_t quiet_ticks = 0;      ///< law 3
  bool recovered = false;             ///< law 4 is in force
  double authority = 1;               ///< law 4: share of the torques while running
};

int ramp_ticks(const SafetyTiming& timing, double rate_Hz) noexcept;

/// What law 4's share rises by in a tick, in 0..; 1 and more: at once.
double rise_per_tick(const SafetyTiming& timing, double rate_Hz) noexcept;

/// A fault found at `t_s`. Returns whether it is now the one that is latched.
bool raise(Safety& safety, Fault fault, double t_s) noexcept;

/// A request for recovery; true if it has an effect: in `fault`, when torques are zero.
bool recover(Safety& safety, const SafetyTiming& timing, double rate_Hz) noexcept;

/// After the checks of a tick: `fault` is what they found, if anything, `seen` whether a state was
/// ever read, `free` whether no sheet bears the tool. Moves the machine on by one tick.
void advance(Safety& safety, const SafetyTiming& timing, double rate_Hz, Fault fault, double t_s,
             bool seen, bool free) noexcept;

/// The factor of law 2 for this tick (called once a tick outside `running`), on the torques at
/// which `running` was left.
double ramp_factor(Safety& safety, const SafetyTiming& timing, double rate_Hz) noexcept;

/// Are torques zero because a fault's ramp has ended?
bool at_rest(const Safety& safety, const SafetyTiming& timing, double rate_Hz) noexcept;

}  // namespace trocar::runtime
