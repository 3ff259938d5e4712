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
    is_paused_ = is_zeroed_ = is_stopped_ = false;
    is_recovery_requested_ = true;
  }
  if (!given.pause && !given.zero && !given.emergency_stop) return;
  is_paused_ |= given.pause;
  is_zeroed_ |= given.zero;
  is_stopped_ |= given.emergency_stop;
  forget_recovery();
}

Fault OperatorCommands::latched_fault() const noexcept {
  if (is_stopped_) return Fault::kEmergencyStop;
  if (is_zeroed_) return Fault::kForcesOff;
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
