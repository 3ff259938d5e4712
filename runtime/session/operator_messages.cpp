// SPDX-License-Identifier: Apache-2.0
#include "runtime/session/operator_messages.h"

#include "formats/base/text.h"

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

namespace {

static_assert(kFaults < 64, "RecoveryWatch has a bit for each fault and one more");

std::string seconds(double t_s) {
  return text_line("%.4f s", t_s);
}

std::string reason(const OperatorMessage& message) {
  if (message.detail.fault == Fault::kNone) {
    // The distance is rounded up, so that lifting by it suffices.
    const auto up_mm = static_cast<long long>(std::ceil(message.retract_distance_m * 1e3 - 1e-6));
    return "the tool is in material: lift it " + std::to_string(std::max(1LL, up_mm)) + " mm";
  }
  return with_advice(words_of(message.detail.fault).meaning_in_recovery, message.detail);
}

}  // namespace

std::string describe(const OperatorMessage& message) {
  switch (message.kind) {
    case OperatorMessage::Kind::kFault:
      return "fault " + trocar::describe(message.detail, message.t_s);
    case OperatorMessage::Kind::kNotRecovered:
      return "no recovery yet at " + seconds(message.t_s) + ": " + reason(message);
    case OperatorMessage::Kind::kRecovered:
      return "recovered at " + seconds(message.t_s) + " from the fault " +
             to_string(message.detail.fault) + ": forces rise again";
    case OperatorMessage::Kind::kRefused:
      return "recovery refused at " + seconds(message.t_s) + ": " +
             refusal_words(message.detail.fault);
    case OperatorMessage::Kind::kSoftened:
      return "force softened at " + seconds(message.t_s) + ": " + kSoftenedWords;
  }
  return {};
}

OperatorMessages::OperatorMessages(std::function<void(const OperatorMessage&)> report)
    : TickObserver(std::chrono::milliseconds(5)), report_(std::move(report)) {}

void OperatorMessages::serve() {
  OperatorMessage message;
  while (waiting_.pop(message))
    report_(message);
}

bool RecoveryWatch::should_report(bool waiting, double t_s, const FaultDetail& found,
                                  double retract_distance_m) noexcept {
  if (!waiting) {
    requested_t_s_ = -1;
    return false;
  }
  if (requested_t_s_ < 0) requested_t_s_ = t_s;
  if (t_s - requested_t_s_ < kPatience_s) return false;
  if (found.fault == Fault::kNone && !(retract_distance_m > 0)) return false;
  // The bit of kNone stands for a tool in material.
  const std::uint64_t bit = std::uint64_t{1} << static_cast<unsigned>(found.fault);
  if ((reported_ & bit) != 0) return false;
  reported_ |= bit;
  return true;
}

std::span<const OperatorMessage> MessageSource::update(const TickResult& result) noexcept {
  using Kind = OperatorMessage::Kind;
  count_ = 0;
  if (result.guard_acted && result.row.t_s - softened_t_s_ >= kSoftenedPause_s) {
    softened_t_s_ = result.row.t_s;
    add(Kind::kSoftened, result, {});
  }
  if (result.new_fault != Fault::kNone) {
    stopped_by_ = result.new_fault;
    watch_.fault_latched();
    add(Kind::kFault, result, result.found);
  }
  if (result.recovery_is_refused && result.row.t_s - refused_t_s_ >= kRefusalPause_s) {
    refused_t_s_ = result.row.t_s;
    add(Kind::kRefused, result, result.found);
  }
  if (stopped_by_ != Fault::kNone) {
    const SafetyState state = result.row.safety;
    const bool waiting = state == SafetyState::kRecovering || state == SafetyState::kReady;
    if (watch_.should_report(waiting, result.row.t_s, result.found, result.retract_distance_m))
      add(Kind::kNotRecovered, result, result.found);
    if (state == SafetyState::kRunning)
      add(Kind::kRecovered, result, std::exchange(stopped_by_, Fault::kNone));
  }
  return std::span(messages_.data(), count_);
}

void MessageSource::add(OperatorMessage::Kind kind, const TickResult& result,
                        const FaultDetail& detail) noexcept {
  const bool is_held_up = kind == OperatorMessage::Kind::kNotRecovered;
  messages_[count_++] = {kind, result.row.t_s, detail, is_held_up ? result.retract_distance_m : 0};
}

}  // namespace trocar::runtime
