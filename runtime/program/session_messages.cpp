// SPDX-License-Identifier: Apache-2.0
#include "runtime/program/session_messages.h"

#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <optional>

#include "formats/base/program.h"
#include "formats/base/terminal_text.h"
#include "formats/session/held_stops.h"

namespace trocar::runtime {
namespace {

constexpr int kProgressWidth = 72;

/// Returns the error of the first hole that could not be cut. Later holes in the same sheet fail
/// because of it.
std::optional<Error> failed_hole(const SessionResult& report, const Remesher& remesher) {
  const auto& records = remesher.records();
  const auto failed = std::find_if(records.begin(), records.end(), [](const CutRecord& record) {
    return record.error.has_value();
  });
  if (failed == records.end()) return std::nullopt;
  const CutRequest& request = failed->request;
  const auto event = std::find_if(
      report.punctures.begin(), report.punctures.end(), [&](const PunctureEvent& puncture) {
        return puncture.sheet == request.sheet && puncture.cut == request.cut;
      });
  const auto sheet = static_cast<std::size_t>(request.sheet);
  std::string what = "slice " + std::to_string(remesher.first_version(sheet).slice_index) +
                     ": hole " + std::to_string(request.cut);
  if (event != report.punctures.end()) what += " (at " + std::to_string(event->t_s) + " s)";
  return Error{failed->error->code, what + " could not be cut: " + failed->error->message};
}

/// Prints a line for each black box. Returns false if one could not be written.
bool print_black_boxes(const SessionResult& report) {
  bool written = report.black_boxes_lost == 0;
  for (const BlackBoxFile& box : report.black_boxes) {
    if (box.error) {
      print(stderr, "trocar-run: black box: %s\n", box.error->message);
      written = false;
    } else {
      print(stderr, "trocar-run: black box: %s\n", box.file);
    }
  }
  return written;
}

/// Returns the causes of missed deadlines, such as " (waking 12, law 1)"; empty: none was missed.
std::string causes_of(const LateTicks::Counts& late_ticks) {
  std::string causes;
  for (std::size_t part = 0; part < kTickParts; ++part) {
    if (late_ticks.at(part) == 0) continue;
    causes += causes.empty() ? " (" : ", ";
    causes += std::string(kTickPartNames.at(part)) + " " + std::to_string(late_ticks.at(part));
  }
  return causes.empty() ? causes : causes + ")";
}

/// Returns true if the operator can end what the message says with SIGUSR1 only.
bool asks_for_signal(const RunArguments& arguments, const OperatorMessage& message) {
  if (!arguments.replay.empty() || arguments.recover == "never" ||
      message.detail.fault == Fault::kRecordingFailed)
    return false;
  return (message.kind == OperatorMessage::Kind::kFault &&
          (arguments.recover == "signal" || is_stop(message.detail.fault))) ||
         message.kind == OperatorMessage::Kind::kRefused;
}

}  // namespace

int fail(const Error& error) {
  return report_error(kProgram, error);
}

void warn(const RunArguments& arguments, const std::string& what) {
  print(stderr, "trocar-run: warning: %s: %s\n", arguments.scene, what);
}

void Progress::serve() {
  RecordingRow row;
  if (!latest_.read(row)) return;
  print(stderr, "\r%7.2f of %.2f s  tip %8.4f m  force %6.2f N  %-10s", row.t_s, duration_s_,
        row.tool_m[2], row.wrench_wanted[2], to_string(row.phase));
}

void Progress::stop() {
  join();
  print(stderr, "\r%*s\r", kProgressWidth, "");
}

void print_message(const RunArguments& arguments, const OperatorMessage& message) {
  std::string line = kProgram + std::string(": ") + describe(message);
  if (asks_for_signal(arguments, message))
    line += "; then request recovery: kill -USR1 " + std::to_string(::getpid());
  if (::isatty(STDERR_FILENO) != 0) print(stderr, "\r%*s\r", kProgressWidth, "");
  print(stderr, "%s\n", line);
  std::fflush(stderr);
}

void print_outcome(const SessionResult& report, const SessionOptions& options) {
  print(stdout,
        "%llu ticks at %.6g Hz, %llu missed deadlines%s, largest force %.3f N, largest torque "
        "%.3f Nm\n",
        static_cast<unsigned long long>(report.ticks), options.rate_Hz,
        static_cast<unsigned long long>(report.realtime.missed_deadlines),
        causes_of(report.late_ticks), report.max_force_N, report.torque_max_Nm);
  constexpr double kMinShown_N = 5e-4;
  if (report.max_force_N < kMinShown_N && report.punctures.empty() && report.fault == Fault::kNone)
    std::printf("the tool touched nothing; trocar-run --check says why\n");
  for (const PunctureEvent& event : report.punctures) {
    std::printf(
        "slice %d was punctured at %.4f s: %.3f N at the tip, %.3f N on the hand, depth %.3f mm, "
        "tip at %.5f m\n",
        event.slice, event.t_s, event.tip_N, event.hand_N, event.penetration_m * 1e3,
        event.tool_z_m);
  }
  for (const BreakThroughEvent& found : report.break_throughs)
    std::printf("the tip %s\n",
                describe_break_through(found.at, found.t_s, found.resistance_N).c_str());
  if (!options.replay.empty() && report.replay_first_difference < 0 &&
      report.ticks == options.replay.size()) {
    std::printf("replay: all torques identical to the recording's\n");
  }
}

int conclude(const SessionResult& report, std::vector<Error> errors, const Remesher& remesher) {
  if (const std::optional<Error> hole = failed_hole(report, remesher)) errors.push_back(*hole);
  const bool black_boxes_written = print_black_boxes(report);
  int code = black_boxes_written ? 0 : static_cast<int>(ExitCode::kUnwritable);
  for (const Error& error : errors) {
    const int error_code = fail(error);
    if (code == 0) code = error_code;
  }
  const bool has_failed = report.end == SessionEnd::kFault;
  if (has_failed) {
    print(stderr, "trocar-run: stopped at %.4f s by the fault %s\n", report.fault_t_s,
          to_string(report.fault));
  }
  if (report.replay_first_difference >= 0) {
    return fail(refused("the torques differ from the recording's from row " +
                        std::to_string(report.replay_first_difference + 1) + " on"));
  }
  if (!has_failed) return code;
  return static_cast<int>(ExitCode::kDeviceFault);
}

}  // namespace trocar::runtime
