// SPDX-License-Identifier: Apache-2.0
#include "runtime/session/operator_commands.h"

namespace trocar::runtime {

void OperatorCommands::apply(const TelemetryCommands& given, Fault latched) noexcept {
  const bool is_signalled = recover_ != nullptr && recover_->exchange(false);
  // A session without recovery only waits after the operator's own commands.
  const bool is_recover =
      given.recover || (is_signalled && (policy_ != RecoveryPolicy::kNever || is_stop(latched) ||
                                         latched_fault() != Fault::kNone));
  is_recovery_requested_ = is_recover;
  if (is_recover) is_paused_ = forces_are_off_ = emergency_stop_ = false;
  if (given.resume && std::exchange(is_paused_, false))
    is_recovery_requested_ |= latched == Fault::kPaused && latched_fault() == Fault::kNone;
  is_paused_ |= given.pause;
  forces_are_off_ |= given.zero;
  emergency_stop_ |= given.emergency_stop;
  if (latched_fault() != Fault::kNone) is_recovery_requested_ = false;
}

Fault OperatorCommands::latched_fault() const noexcept {
  if (emergency_stop_) return Fault::kEmergencyStop;
  if (forces_are_off_) return Fault::kForcesOff;
  return is_paused_ ? Fault::kPaused : Fault::kNone;
}

RecoveryRequest OperatorCommands::request() const noexcept {
  if (is_recovery_requested_) return RecoveryRequest::kByOperator;
  return policy_ == RecoveryPolicy::kAuto ? RecoveryRequest::kAutomatic : RecoveryRequest::kNone;
}

}  // namespace trocar::runtime
