// SPDX-License-Identifier: Apache-2.0
// The operator's commands while a session runs: pause, zero, emergency stop, resume, recover.
//
// Pause, zero and emergency stop are latched. While one is set, its fault is raised in every tick.
// Its fault therefore returns after any other fault, and recovery is blocked. `resume` releases the
// pause, and `recover` releases all three.
// Tests: tests/runtime/session/live_session_test.cpp
#pragma once

#include <atomic>

#include "formats/session/recording.h"
#include "runtime/session/session_options.h"
#include "runtime/telemetry/session_publisher.h"

namespace trocar::runtime {

class OperatorCommands {
 public:
  /// `recover` is SessionOptions::recover and may be null.
  OperatorCommands(RecoveryPolicy policy, std::atomic<bool>* recover)
      : policy_(policy), recover_(recover) {}

  // The haptic thread calls these functions.

  /// Applies the commands given since the last tick. `latched`: fault latched by the
  /// safety state machine.
  void apply(const TelemetryCommands& given, Fault latched) noexcept;
  /// Returns the fault to raise in each tick while a command is latched, or none.
  Fault latched_fault() const noexcept;
  bool is_paused() const noexcept { return is_paused_ && !is_stopped_; }
  /// If this returns true, a session with RecoveryPolicy::kNever waits for the operator
  /// instead of ending.
  bool waits_for_operator(Fault latched) const noexcept {
    return is_by_operator(latched) && !is_stopped_;
  }
  /// Returns true if recovery is to be requested in this tick, and clears the operator's request.
  bool take_recovery() noexcept;
  /// Clears the operator's request. Called when a fault is latched, because a request made before
  /// the fault does not apply to it.
  void forget_recovery() noexcept;

 private:
  RecoveryPolicy policy_;
  std::atomic<bool>* recover_;
  bool is_paused_ = false, is_zeroed_ = false, is_stopped_ = false;
  bool is_recovery_requested_ = false;  ///< a command requested it
};

}  // namespace trocar::runtime
