// SPDX-License-Identifier: Apache-2.0
#include "tests/stand_ins/haply/journal.h"

#include <charconv>
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <utility>

namespace trocar::haply_stand_in {

namespace {

constexpr std::size_t kLogBytes = std::size_t{64} << 20;

}  // namespace

Journal::Journal(const std::string& log, std::string summary, double force_limit_N)
    : log_name_(log), summary_(std::move(summary)), force_limit_N_(force_limit_N) {
  if (log.empty()) return;
  log_.reset(std::fopen(log.c_str(), "w"));
  if (!log_) throw std::runtime_error(log + ": cannot be written");
  buffer_.resize(kLogBytes);
  std::setvbuf(log_.get(), buffer_.data(), _IOFBF, buffer_.size());
  std::fputs("message,time_s,fx_N,fy_N,fz_N,x_m,y_m,z_m,arm_time_s\n", log_.get());
}

void Journal::take(const CommandMessage& message, double t_s, const Arm& arm) {
  ++counts.messages;
  counts.invalid_messages += !message.is_valid;
  counts.misspelt_forces += message.is_misspelt;
  counts.unusable_forces += message.has_unusable_force;
  counts.other_device += message.names_other_device;
  ends_with_force_ = message.force_N.has_value();
  if (!ends_with_force_) {
    counts.idle_messages += message.is_valid;
    return;
  }
  ++counts.forces;
  last_force_N_ = *message.force_N;
  last_force_s_ = t_s;
  const double norm = std::hypot(last_force_N_[0], last_force_N_[1], last_force_N_[2]);
  counts.largest_force_N = std::fmax(counts.largest_force_N, norm);
  // A client that limits a force in floating point may exceed the limit by rounding.
  counts.over_limit_forces += norm > force_limit_N_ * (1 + 1e-9);
  if (log_) log_force(last_force_N_, t_s, arm);
}

void Journal::log_force(const Vec3& force_N, double t_s, const Arm& arm) {
  char line[320];
  char* const end = line + sizeof line;
  char* out = std::to_chars(line, end, counts.messages).ptr;
  const auto add = [&](double value) {
    *out++ = ',';
    out = std::to_chars(out, end, value).ptr;
  };
  add(t_s);
  for (const double component : force_N)
    add(component);
  for (const double component : arm.position_m())
    add(component);
  add(arm.time_s());
  *out++ = '\n';
  std::fwrite(line, 1, static_cast<std::size_t>(out - line), log_.get());
}

void Journal::finish(const std::vector<Fault>& faults, double t_s) {
  if (log_ && (std::fflush(log_.get()) != 0 || std::ferror(log_.get())))
    throw std::runtime_error(log_name_ + ": cannot be written");
  if (summary_.empty()) return;
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  for (const Fault& fault : faults)
    list.push_back({{"kind", fault.name},
                    {"at_s", fault.at_s},
                    {"answers", fault.answers},
                    {"first_s", fault.answers > 0 ? nlohmann::ordered_json(fault.first_s)
                                                  : nlohmann::ordered_json(nullptr)}});
  const nlohmann::ordered_json root = {
      {"clients", counts.clients},
      {"messages", counts.messages},
      {"answers", counts.answers},
      {"forces", counts.forces},
      {"idle_messages", counts.idle_messages},
      {"invalid_messages", counts.invalid_messages},
      {"misspelt_forces", counts.misspelt_forces},
      {"unusable_forces", counts.unusable_forces},
      {"over_limit_forces", counts.over_limit_forces},
      {"other_device", counts.other_device},
      {"protocol_errors", counts.protocol_errors},
      {"largest_force_N", counts.largest_force_N},
      {"last_force_N", last_force_N_},
      {"last_force_s", last_force_s_},
      {"ends_with_force", ends_with_force_},
      {"time_s", t_s},
      {"faults", std::move(list)},
  };
  std::ofstream file(summary_);
  file << root.dump(2) << '\n';
  if (!file.flush()) throw std::runtime_error(summary_ + ": cannot be written");
}

}  // namespace trocar::haply_stand_in
