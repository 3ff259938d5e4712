// SPDX-License-Identifier: Apache-2.0
#include "formats/session/telemetry_layout.h"

#include <unistd.h>

#include <climits>
#include <cstdio>

#include "formats/session/telemetry.h"

namespace trocar {
namespace telemetry_layout {

std::string read_link(const std::filesystem::path& file) {
  std::array<char, PATH_MAX> text;
  const ssize_t size = ::readlink(file.c_str(), text.data(), text.size());
  return size <= 0 ? std::string() : std::string(text.data(), static_cast<std::size_t>(size));
}

bool is_session_link(const std::string& target) {
  int pid = 0, fd = 0, end = 0;
  return std::sscanf(target.c_str(), "/proc/%9d/fd/%9d%n", &pid, &fd, &end) == 2 &&
         static_cast<std::size_t>(end) == target.size() && pid > 0 && fd >= 0;
}

}  // namespace telemetry_layout

const char* to_string(TelemetryCommand command) {
  constexpr std::array kNames{"stop",    "pause",          "resume",   "zero",
                              "recover", "emergency_stop", "xray_shot"};
  static_assert(kNames.size() == kTelemetryCommands);
  return kNames.at(static_cast<std::size_t>(command));
}

const char* to_string(TelemetryEventKind kind) {
  constexpr std::array kNames{"puncture",  "fault",       "not_recovered", "recovered",
                              "cut_shown", "paused",      "resumed",       "ended",
                              "hand",      "hand_let_go", "hand_lost",     "xray_shot",
                              "xray_on",   "xray_off",    "break_through", "recovery_refused"};
  static_assert(kNames.size() == kTelemetryEventKinds);
  return kNames.at(static_cast<std::size_t>(kind) - 1);
}

const char* to_string(TelemetryEnd end) {
  constexpr std::array kNames{"done", "interrupted", "fault"};
  return kNames.at(static_cast<std::size_t>(end));
}

}  // namespace trocar
