// SPDX-License-Identifier: Apache-2.0
#include "tests/stand_ins/haply/service.h"

#include <algorithm>
#include <fstream>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>
#include <utility>

namespace stand_in {
namespace {

constexpr double kLate_s = 0.03, kJump_m = 0.05, kRestart_s = 1, kMaxForce_N = 50;
constexpr double kIdleAfter_s = 0.02;  // a force ends if no message follows for this long
constexpr double kMaxCatchUp_s = 0.05;
constexpr std::size_t kPadding = 2'000'000, kDepth = 100'000, kBinarySize = 64;
constexpr std::size_t kLogBytes = std::size_t{64} << 20;

double seconds_between(Service::Clock::time_point from, Service::Clock::time_point to) {
  return std::chrono::duration<double>(to - from).count();
}

/// Applies a fault that shows in the content of a state.
void spoil_state(std::string_view kind, StateMessage& state) {
  if (kind == "wrong-types") state.coordinate = "\"0.1\"";
  if (kind == "nan") state.coordinate = "NaN";
  if (kind == "big-number") state.coordinate = "1e300";
  if (kind == "jump") state.measured.position_m.x() += kJump_m;
  if (kind == "other-id") state.device_id = "FFFF";
  if (kind == "removed") state.arms = ArmList::kEmpty;
  if (kind == "no-inverse3") state.arms = ArmList::kMissing;
  if (kind == "not-ready") state.is_ready = false;
}

/// Applies any other fault.
void spoil_answer(std::string_view kind, Answer& answer) {
  if (kind == "silence") answer.act = Act::kStaySilent;
  if (kind == "disconnect") answer.act = Act::kReset;
  if (kind == "close") answer.act = Act::kClose;
  if (kind == "restart") answer.act = Act::kRestart;
  if (kind == "late") answer.delay_s = kLate_s;
  if (kind == "twice") answer.copies = 2;
  if (kind == "garbage") answer.bytes = "<html>503 ]}\t not JSON";
  if (kind == "truncated") answer.bytes.resize(answer.bytes.size() / 2);
  if (kind == "huge") answer.bytes.insert(1, "\"padding\":\"" + std::string(kPadding, 'x') + "\",");
  if (kind == "deep")
    answer.bytes = "{\"inverse3\":" + std::string(kDepth, '[') + std::string(kDepth, ']') + '}';
  if (kind != "binary") return;
  answer.is_binary = true;
  answer.bytes.clear();
  for (std::size_t i = 0; i < kBinarySize; ++i)
    answer.bytes += static_cast<char>(i * 4);
}

}  // namespace

Service::Service(ServiceSettings settings)
    : settings_(std::move(settings)), arm_(settings_.path, settings_.arm) {
  if (settings_.log.empty()) return;
  log_.reset(std::fopen(settings_.log.c_str(), "w"));
  if (!log_) throw std::runtime_error(settings_.log + ": cannot be written");
  log_buffer_.resize(kLogBytes);
  std::setvbuf(log_.get(), log_buffer_.data(), _IOFBF, log_buffer_.size());
  std::fputs("message,time_s,fx_N,fy_N,fz_N,x_m,y_m,z_m,arm_time_s\n", log_.get());
}

double Service::now_s() const {
  return has_started_ ? seconds_between(start_, Clock::now()) : -1;
}

void Service::advance() {
  if (!has_started_) return;
  const auto now = Clock::now();
  // A machine that stood still causes no jump.
  const double elapsed_s = std::min(seconds_between(advanced_, now), kMaxCatchUp_s);
  const Eigen::Vector3d none = Eigen::Vector3d::Zero();
  const double end_s = arm_.t_s() + elapsed_s;
  arm_.advance(arm_.t_s() + std::min(elapsed_s, kIdleAfter_s), applied_N_, none);
  arm_.advance(end_s, none, none);
  advanced_ = now;
}

int Service::begin_session(Answer& inventory) {
  const int session = ++last_session_;
  advance();
  StateMessage message = state();
  message.has_config = true;
  if (settings_.protocol == Protocol::kV35) message.session_id = session;
  inventory = answer(message);
  return session;
}

void Service::apply(int session, const CommandMessage& message) {
  if (!message.force_N) {
    applied_N_.setZero();
    force_session_ = 0;
    return;
  }
  if (!has_started_) {
    has_started_ = true;
    start_ = advanced_ = Clock::now();
  }
  force_session_ = session;
  const double norm = message.force_N->norm();
  const Eigen::Vector3d force_N = *message.force_N * (norm > kMaxForce_N ? kMaxForce_N / norm : 1);
  const double gain = settings_.force_gate_gain;
  applied_N_ = gain * applied_N_ + (1 - gain) * force_N;
}

void Service::keep(const CommandMessage& message) {
  ++messages_;
  invalid_ += message.is_valid ? 0 : 1;
  misspelt_ += message.is_misspelt ? 1 : 0;
  unusable_ += message.has_unusable_force ? 1 : 0;
  if (!message.force_N) return;
  ++forces_;
  if (!log_) return;
  const Eigen::Vector3d &f = *message.force_N, &p = arm_.position_m();
  std::fprintf(log_.get(), "%llu,%.17g,%.17g,%.17g,%.17g,%.17g,%.17g,%.17g,%.17g\n",
               static_cast<unsigned long long>(messages_), seconds_between(start_, advanced_),
               f.x(), f.y(), f.z(), p.x(), p.y(), p.z(), arm_.t_s());
}

Answer Service::receive(int session, std::string_view text) {
  advance();
  const CommandMessage message = parse_command(text, settings_.protocol);
  apply(session, message);
  keep(message);
  StateMessage shown = state();
  shown.has_config = message.wants_config;
  return answer(shown);
}

void Service::end_session(int session) {
  if (force_session_ != session) return;
  advance();
  applied_N_.setZero();
  force_session_ = 0;
}

StateMessage Service::state() {
  StateMessage message;
  message.protocol = settings_.protocol;
  message.force_gate_gain = settings_.force_gate_gain;
  message.in_use = has_started_;
  message.has_grip = settings_.has_grip;
  message.measured = {settings_.readings.of(arm_.position_m()),
                      arm_.velocity_m_per_s(),
                      applied_N_,
                      force_session_ == 0,
                      arm_.orientation(),
                      arm_.buttons()};
  return message;
}

/// The first fault that applies to an answer at `now_s`, and counts it; null if there is none.
Fault* Service::take_fault(double now_s) {
  for (Fault& fault : settings_.faults) {
    if (now_s < fault.start_s) continue;
    // A restart happens once, because nobody can ask while it lasts.
    const bool is_once = !fault.duration_s || fault.kind == "restart";
    if (is_once ? fault.answers > 0 : now_s >= fault.start_s + *fault.duration_s) continue;
    ++fault.answers;
    return &fault;
  }
  return nullptr;
}

Answer Service::answer(StateMessage message) {
  const Fault* fault = take_fault(now_s());
  if (fault && fault->kind == "frozen") message.measured = shown_;
  shown_ = message.measured;
  Answer answer;
  answer.delay_s = settings_.readings.late_s();
  if (fault) spoil_state(fault->kind, message);
  answer.bytes = text_of(message);
  if (fault) {
    spoil_answer(fault->kind, answer);
    answer.restart_s = fault->duration_s.value_or(kRestart_s);
  }
  if (answer.act == Act::kSend) answers_ += static_cast<unsigned>(answer.copies);
  return answer;
}

void Service::finish() {
  if (log_ && std::fflush(log_.get()) != 0)
    throw std::runtime_error(settings_.log + ": cannot be written");
  if (settings_.summary.empty()) return;
  nlohmann::ordered_json root = {
      {"messages", messages_},
      {"answers", answers_},
      {"forces", forces_},
      {"invalid_messages", invalid_},
      {"misspelt_forces", misspelt_},
      {"unusable_forces", unusable_},
      {"ends_with_force", force_session_ != 0},
      {"faults", nlohmann::ordered_json::array()},
  };
  for (const Fault& fault : settings_.faults)
    root["faults"].push_back({{"kind", fault.kind}, {"answers", fault.answers}});
  std::ofstream file(settings_.summary);
  file << root.dump(2) << '\n';
  if (!file.flush()) throw std::runtime_error(settings_.summary + ": cannot be written");
}

}  // namespace stand_in
