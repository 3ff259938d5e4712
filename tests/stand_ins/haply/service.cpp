// SPDX-License-Identifier: Apache-2.0
#include "tests/stand_ins/haply/service.h"

#include <optional>
#include <utility>

namespace trocar::haply_stand_in {
namespace {

constexpr double kLate_s = 0.03, kJump_m = 0.05, kRestart_s = 1;
constexpr std::size_t kPadding = 2'000'000, kDepth = 100'000, kBinarySize = 64;

double seconds_between(Service::Clock::time_point from, Service::Clock::time_point to) {
  return std::chrono::duration<double>(to - from).count();
}

/// Applies a fault that shows in the content of a state, and returns false for any other fault.
bool spoil_state(FaultKind kind, StateMessage& state) {
  switch (kind) {
    case FaultKind::kWrongTypes:
      state.coordinate = "\"0.1\"";
      return true;
    case FaultKind::kNull:
      state.coordinate = "null";
      return true;
    case FaultKind::kNan:
      state.coordinate = "NaN";
      return true;
    case FaultKind::kBigNumber:
      state.coordinate = "1e300";
      return true;
    case FaultKind::kOverflow:
      state.coordinate = "1e999";
      return true;
    case FaultKind::kJump:
      state.measured.position_m[0] += kJump_m;
      return true;
    case FaultKind::kOtherId:
      state.device_id = "FFFF";
      return true;
    case FaultKind::kMissingDevice:
      state.arms = ArmList::kOnlySecond;
      return true;
    case FaultKind::kRemoved:
      state.arms = ArmList::kEmpty;
      return true;
    case FaultKind::kNoInverse3:
      state.arms = ArmList::kMissing;
      return true;
    case FaultKind::kNoState:
      state.arms = ArmList::kNoState;
      return true;
    case FaultKind::kNotReady:
      state.is_ready = false;
      return true;
    default:
      return false;
  }
}

}  // namespace

Service::Service(ServiceSettings settings)
    : settings_(std::move(settings)),
      journal_(settings_.log, settings_.summary, settings_.force_limit_N),
      arm_(settings_.arm, settings_.keyframes) {}

double Service::now_s() const {
  return has_started_ ? seconds_between(start_, Clock::now()) : -1;
}

void Service::advance() {
  if (!has_started_) return;
  const auto now = Clock::now();
  arm_.advance(seconds_between(advanced_, now), applied_N_);
  advanced_ = now;
}

int Service::begin_session(Answer& inventory) {
  ++journal_.counts.clients;
  const int session = ++last_session_;
  force_gates_[session] = settings_.force_gate_gain;
  advance();
  StateMessage message = state();
  message.has_inverse3_config = message.has_grip_config = true;
  if (protocol() == Protocol::kV35) message.session_id = session;
  inventory = answer(message);
  return session;
}

void Service::apply(int session, const CommandMessage& message) {
  if (message.force_gate_gain) force_gates_[session] = *message.force_gate_gain;
  if (!message.preset.empty()) preset_ = message.preset;
  if (!message.force_N) {
    applied_N_ = {};
    force_session_ = 0;
    return;
  }
  if (!has_started_) {
    has_started_ = true;
    start_ = advanced_ = Clock::now();
  }
  force_session_ = session;
  const double gain = force_gates_[session];
  const Vec3 force_N = motor_force(*message.force_N);
  for (std::size_t i = 0; i < 3; ++i)
    applied_N_[i] = gain * applied_N_[i] + (1 - gain) * force_N[i];
}

Answer Service::receive(int session, std::string_view text) {
  advance();
  const CommandMessage message = parse_command(text, settings_.dialect);
  apply(session, message);
  journal_.take(message, has_started_ ? seconds_between(start_, advanced_) : 0, arm_);
  StateMessage shown = state();
  shown.has_inverse3_config = message.wants_inverse3_config;
  shown.has_grip_config = message.wants_grip_config;
  shown.force_gate_gain = force_gates_[session];
  return answer(shown);
}

void Service::end_session(int session, bool by_protocol_error) {
  journal_.counts.protocol_errors += by_protocol_error;
  force_gates_.erase(session);
  if (force_session_ != session) return;
  advance();
  applied_N_ = {};
  force_session_ = 0;
}

StateMessage Service::state() const {
  StateMessage message;
  message.protocol = protocol();
  message.device_id = settings_.dialect.device_id;
  message.handedness = settings_.handedness;
  message.preset = preset_;
  message.force_gate_gain = settings_.force_gate_gain;
  message.in_use = has_started_;
  message.has_second_device = settings_.has_second_device;
  message.grip = settings_.grip;
  message.numbers_buttons = settings_.numbers_buttons;
  message.measured = {arm_.position_m(),   arm_.velocity_m_per_s(), applied_N_,
                      force_session_ == 0, arm_.hand().orientation, arm_.hand().buttons};
  return message;
}

Answer Service::answer(StateMessage message) {
  const Fault* fault = take_fault(settings_.faults, now_s());
  if (fault && fault->kind == FaultKind::kFrozen) message.measured = shown_;
  shown_ = message.measured;
  Answer answer;
  const bool is_in_state = fault && spoil_state(fault->kind, message);
  answer.bytes = text_of(message);
  if (fault && !is_in_state) {
    spoil_payload(fault->kind, answer);
    if (answer.act == Act::kRestart) answer.restart_s = fault->duration_s.value_or(kRestart_s);
  }
  if (answer.act == Act::kSend) journal_.counts.answers += static_cast<unsigned>(answer.copies);
  return answer;
}

void Service::spoil_payload(FaultKind kind, Answer& answer) {
  switch (kind) {
    case FaultKind::kSilence:
      answer.act = Act::kStaySilent;
      break;
    case FaultKind::kDisconnect:
      answer.act = Act::kReset;
      break;
    case FaultKind::kClose:
      answer.act = Act::kClose;
      break;
    case FaultKind::kRestart:
      answer.act = Act::kRestart;
      break;
    case FaultKind::kLate:
      answer.delay_s = kLate_s;
      break;
    case FaultKind::kTwice:
      answer.copies = 2;
      break;
    case FaultKind::kGarbage:
      answer.bytes = "<html>503 ]}\t not JSON";
      break;
    case FaultKind::kBadUtf8:
      answer.bytes = "{\"inverse3\":\"\xff\xfe\xc0\"}";
      break;
    case FaultKind::kTruncated:
      answer.bytes.resize(answer.bytes.size() / 2);
      break;
    case FaultKind::kBinary:
      answer.is_binary = true;
      answer.bytes.assign(kBinarySize, '\0');
      for (std::size_t i = 0; i < kBinarySize; ++i)
        answer.bytes[i] = static_cast<char>(i * 4);
      break;
    case FaultKind::kHuge:
      answer.bytes.insert(1, "\"padding\":\"" + std::string(kPadding, 'x') + "\",");
      break;
    case FaultKind::kDeep:
      answer.bytes = "{\"inverse3\":" + std::string(kDepth, '[') + std::string(kDepth, ']') + '}';
      break;
    default:
      break;
  }
}

std::string Service::inventory() const {
  StateMessage message = state();
  message.has_inverse3_config = message.has_grip_config = true;
  return text_of(message);
}

void Service::finish() {
  journal_.finish(settings_.faults, has_started_ ? now_s() : 0);
}

}  // namespace trocar::haply_stand_in
