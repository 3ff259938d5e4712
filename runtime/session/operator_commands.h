// SPDX-License-Identifier: Apache-2.0
// The operator's commands while a session runs: pause, zero, emergency stop, resume, recover.
//
// Pause, zero (no forces) and emergency stop are latched: each stays set until it is released.
// While a command is set, the command's fault is raised in every tick, and no recovery begins.
// `resume` releases the pause. If the session's latched fault is that of the pause, `resume` also
// requests a recovery. `recover` releases all three commands and requests a recovery. The signal
// SIGUSR1 does the same as `recover`; the program's signal handler sets the flag
// SessionOptions::recover. With RecoveryPolicy::kNever, the signal has no effect after a failed
// check. A request goes to the tick that follows it, and is never kept: that tick takes or refuses
// it (safety.h).
#pragma once

#include <atomic>

#include "formats/session/recording.h"
#include "runtime/session/session_options.h"
#include "runtime/telemetry/session_publisher.h"

namespace trocar::runtime {

class OperatorCommands {
 public:
  /// `recover`: the flag SessionOptions::recover; may be null.
  OperatorCommands(RecoveryPolicy policy, std::atomic<bool>* recover)
      : policy_(policy), recover_(recover) {}

  // The haptic thread calls these functions.

  /// Applies the commands given since the last call. If a stop is among them, it wins. `latched`:
  /// the fault that the safety state machine has latched (Safety::fault), or none. Call this once
  /// before each tick.
  void apply(const TelemetryCommands& given, Fault latched) noexcept;
  /// Returns the fault of the latched command, or none if no command is latched. The caller raises
  /// this fault in the tick.
  Fault latched_fault() const noexcept;
  bool is_paused() const noexcept { return is_paused_ && !emergency_stop_; }
  /// Returns true if `latched` is the fault of the command pause or zero, and no emergency stop is
  /// set. A session with RecoveryPolicy::kNever then waits for the operator instead of ending.
  bool waits_for_operator(Fault latched) const noexcept {
    return is_by_operator(latched) && !emergency_stop_;
  }
  /// Returns the request for recovery of this tick.
  RecoveryRequest request() const noexcept;

 private:
  RecoveryPolicy policy_;
  std::atomic<bool>* recover_;
  bool is_paused_ = false, forces_are_off_ = false, emergency_stop_ = false;
  bool is_recovery_requested_ = false;  ///< by the commands of the last apply()
};

}  // namespace trocar::runtime
