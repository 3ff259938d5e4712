// SPDX-License-Identifier: Apache-2.0
#include "runtime/session/operator_commands.h"

#include <utility>

namespace trocar::runtime {

void OperatorCommands::apply(const TelemetryCommands& given, Fault latched) noexcept {
  const bool is_signalled =
      policy_ == RecoveryPolicy::kOnRequest && recover_ != nullptr && recover_->load();
  if (given.resume && is_paused_) {
    is_paused_ = false;
    if (latched == Fault::kPaused) is_recovery_requested_ = true;
  }
  if (given.recover || (is_signalled && latched_fault() != Fault::kNone)) {
    is_paused_ = forces_are_off_ = emergency_stop_ = false;
    is_recovery_requested_ = true;
  }
  if (!given.pause && !given.zero && !given.emergency_stop) return;
  is_paused_ |= given.pause;
  forces_are_off_ |= given.zero;
  emergency_stop_ |= given.emergency_stop;
  forget_recovery();
}

Fault OperatorCommands::latched_fault() const noexcept {
  if (emergency_stop_) return Fault::kEmergencyStop;
  if (forces_are_off_) return Fault::kForcesOff;
  return is_paused_ ? Fault::kPaused : Fault::kNone;
}

bool OperatorCommands::take_recovery() noexcept {
  if (latched_fault() != Fault::kNone) return false;
  if (std::exchange(is_recovery_requested_, false)) {
    if (recover_ != nullptr) recover_->store(false);
    return true;
  }
  if (policy_ == RecoveryPolicy::kAuto) return true;
  return policy_ == RecoveryPolicy::kOnRequest && recover_ != nullptr && recover_->exchange(false);
}

void OperatorCommands::forget_recovery() noexcept {
  is_recovery_requested_ = false;
  if (recover_ != nullptr) recover_->store(false);
}

}  // namespace trocar::runtime
