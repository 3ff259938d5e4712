// SPDX-License-Identifier: Apache-2.0
#include "runtime/simulation/drive_record.h"

#include <array>
#include <charconv>

namespace trocar::runtime {
namespace {

const char* to_string(DriveMode mode) noexcept {
  switch (mode) {
    case DriveMode::kReady:
      return "ready";
    case DriveMode::kTorque:
      return "torque";
    case DriveMode::kWatchdog:
      return "watchdog";
    case DriveMode::kEmergencyStop:
      break;
  }
  return "emergency_stop";
}

template <typename Number>
void put(std::string& out, Number value, char end) {
  std::array<char, 40> text;
  const auto [last, error] = std::to_chars(text.data(), text.data() + text.size(), value);
  out.append(text.data(), last);
  out += end;
}

}  // namespace

std::string to_csv(std::span<const DriveStep> steps) {
  std::string out =
      "session,t_s,mode,motor_faults,fault,command_taken,commanded_max_Nm,applied_max_Nm,"
      "packets_refused,tool_x_m,tool_y_m,tool_z_m,tool_x_m_per_s,tool_y_m_per_s,tool_z_m_per_s\n";
  for (const DriveStep& step : steps) {
    put(out, step.session, ',');
    put(out, step.t_s, ',');
    out += to_string(step.mode);
    out += ',';
    put(out, int{step.motor_faults}, ',');
    put(out, step.fault ? 1 : 0, ',');
    put(out, step.command_taken, ',');
    put(out, step.commanded_max_Nm, ',');
    put(out, step.applied_max_Nm, ',');
    put(out, step.packets_refused, ',');
    for (const double x : step.tip.at_m)
      put(out, x, ',');
    for (const double v : step.tip.velocity_m_per_s)
      put(out, v, ',');
    out.back() = '\n';
  }
  return out;
}

}  // namespace trocar::runtime
