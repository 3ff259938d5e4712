// SPDX-License-Identifier: Apache-2.0
#include "runtime/program/session_outputs.h"

#include <cstdio>
#include <nlohmann/json.hpp>

#include "formats/base/command_line.h"
#include "formats/base/json.h"
#include "formats/base/text.h"

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
  const RecoveryPolicy recovery = arguments.session.recovery;
  if (!arguments.replay.empty() || recovery == RecoveryPolicy::kNever ||
      message.detail.fault == Fault::kRecordingFailed)
    return false;
  return (message.kind == OperatorMessage::Kind::kFault &&
          (recovery == RecoveryPolicy::kOnRequest || is_stop(message.detail.fault))) ||
         message.kind == OperatorMessage::Kind::kRefused;
}

/// Returns the summary's "link": the number of sessions, and of the device link the number of accepted packets and the
/// numbers of refused packets by reason.
nlohmann::json describe(const LinkReport& link) {
  nlohmann::json out = {{"sessions", link.sessions}};
  if (!link.packets) return out;
  nlohmann::json refused = nlohmann::json::object();
  for (std::size_t i = 1; i < kLinkRefusals; ++i)
    refused[to_string(static_cast<LinkRefusal>(i))] = link.packets->counts.by_refusal[i];
  out["packets_accepted"] = link.packets->counts.accepted();
  out["packets_refused"] = refused;
  out["states_missed"] = link.packets->states_missed;
  return out;
}

/// Returns the file of the session report's figures with this extension.
std::filesystem::path figures_file(const RunArguments& arguments, const char* extension) {
  return arguments.session_report.empty()
             ? std::filesystem::path()
             : std::filesystem::path(arguments.session_report).replace_extension(extension);
}
constexpr const char* kFiguresJson = ".json";
constexpr const char* kFiguresCsv = ".figures.csv";  // NAME.csv may be the recording

std::vector<ReportSheet> report_sheets(const SessionInputs& inputs) {
  std::vector<ReportSheet> sheets;
  sheets.reserve(inputs.sheets.size());
  for (std::size_t i = 0; i < inputs.sheets.size(); ++i)
    sheets.push_back({inputs.sheets[i]->slice_index, inputs.sheets[i]->z_m,
                      i < inputs.tissues.size() ? inputs.tissues[i].choice.name : ""});
  return sheets;
}

/// Returns the `hand` of a scene, with the impedance of `hand` and this path.
std::string describe_hand(const SceneHand& hand, const HandTrajectory& path) {
  const HandImpedance impedance = hand_impedance(hand);
  nlohmann::ordered_json out = {
      {"stiffness_N_per_m", impedance.stiffness_N_per_m},
      {"damping_N_s_per_m", impedance.damping_Ns_per_m},
      {"rotation_stiffness_Nm_per_rad", impedance.rotational_stiffness_Nm_per_rad},
      {"rotation_damping_Nm_s_per_rad", impedance.rotational_damping_Nms_per_rad},
      {"mass_kg", impedance.mass_kg},
      {"trajectory", nlohmann::ordered_json::array()}};
  for (const HandKeyframe& keyframe : path.keyframes) {
    const Eigen::Vector3d tip_m = keyframe.T_device_tool.p_m,
                          turn_deg = rotation_vector(keyframe.T_device_tool.q) * kDegreesPerRadian;
    constexpr double kParts = 1e8;
    auto tip = nlohmann::ordered_json::array(), turn = nlohmann::ordered_json::array();
    for (const double x : tip_m)
      tip.push_back(rounded(x, kParts));
    for (const double x : turn_deg)
      turn.push_back(rounded(x, kParts));
    out["trajectory"].push_back({{"t_s", rounded(keyframe.t_s, kParts)},
                                 {"tip_m", std::move(tip)},
                                 {"rotation_deg", std::move(turn)}});
  }
  return json_text(out);
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
    std::printf("the tool touched nothing; trocar-run check says why\n");
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

Result<void> check_run_outputs(const RunArguments& arguments, const SessionInputs& inputs) {
  const OutputFile outputs[] = {
      {"--record", arguments.session.record.value_or("")},
      {"--summary", arguments.summary},
      {"--meshes", arguments.meshes},
      {"--frames", arguments.frames},
      {"--hand-path", arguments.hand_path},
      {"--session-report", arguments.session_report},
      {"--session-report (its figures)", figures_file(arguments, kFiguresJson)},
      {"--session-report (its figures)", figures_file(arguments, kFiguresCsv)}};
  for (const OutputFile& output : outputs) {
    if (!arguments.live.empty() && output.file == arguments.live)
      return usage("--live " + arguments.live + ": is also the file of " + output.option);
  }
  const std::filesystem::path input_files[] = {arguments.scene, inputs.scene.asset,
                                               inputs.scene.device.value_or(""), arguments.replay,
                                               arguments.key_file};
  return check_outputs(outputs, input_files);
}

SessionOutputs::SessionOutputs(const RunArguments& arguments, const SessionInputs& inputs,
                               double rate_Hz)
    : arguments_(arguments),
      inputs_(inputs),
      sheets_(report_sheets(inputs)),
      frames_(arguments.frames),
      observer_(inputs.scene, sheets_, rate_Hz) {}

void SessionOutputs::collect(SessionOptions& options) {
  if (!arguments_.frames.empty()) {
    options.on_frame = [this](const RecordingRow& row, const auto& shape) {
      frames_.add(row, shape);
    };
  }
  if (!arguments_.session_report.empty())
    options.on_tick = [this](const ObservedTick& tick) { observer_.observe(tick); };
}

ReportFacts SessionOutputs::facts(const SessionFigures& figures, const SessionOptions& options,
                                  const SessionResult& report, const Remesher& remesher) const {
  ReportFacts facts{report, !options.is_real_time(), sheets_};
  if (Result<Trainee> trainee = stated_trainee(options.origin); trainee)
    facts.trainee = std::move(*trainee);
  if (figures.counted > 0) {
    std::vector<const Sheet*> bone;
    for (std::size_t i = 0; i < remesher.size(); ++i)
      bone.push_back(&remesher.first_version(i));
    facts.final_wall = measure_wall_violation(bone, make_tool(inputs_.scene.tool), figures.lowest_m,
                                              figures.lowest_q);
  }
  for (const int axis : {0, 1}) {
    for (std::size_t i = 0; i < remesher.size(); ++i)
      facts.material_m[static_cast<std::size_t>(axis)].push_back(material_along(
          remesher.first_version(i), axis, figures.lowest_m[static_cast<std::size_t>(1 - axis)]));
  }
  return facts;
}

std::vector<Error> SessionOutputs::write(const SessionOptions& options, const SessionResult& report,
                                         const Remesher& remesher, const LiveHand* hand,
                                         const std::optional<LinkReport>& link) {
  std::vector<Error> errors;
  const auto keep_error = [&](const Result<void>& done) {
    if (!done) errors.push_back(done.error());
  };
  if (!arguments_.summary.empty()) {
    const std::string text =
        summarize(inputs_.scene, options, report, remesher, link ? json_text(describe(*link)) : "");
    keep_error(write_file_atomically(arguments_.summary, text + "\n", Readers::kOwner));
  }
  if (!arguments_.meshes.empty()) {
    const std::string text = describe_sheets(inputs_.scene, remesher) + "\n";
    keep_error(write_file_atomically(arguments_.meshes, text));
  }
  if (!arguments_.frames.empty()) keep_error(frames_.finish());
  if (!arguments_.hand_path.empty() && hand != nullptr) {
    const std::string text = describe_hand(inputs_.scene.hand, hand->path().keyframes());
    keep_error(write_file_atomically(arguments_.hand_path, text + "\n"));
  }
  if (!arguments_.session_report.empty()) {
    const SessionFigures figures = observer_.figures();
    const ReportFacts all = facts(figures, options, report, remesher);
    keep_error(write_file_atomically(arguments_.session_report,
                                     session_report_page(inputs_.scene, figures, all),
                                     Readers::kOwner));
    const std::string json = session_report_json(inputs_.scene, figures, all);
    keep_error(write_file_atomically(figures_file(arguments_, kFiguresJson), json + "\n",
                                     Readers::kOwner));
    keep_error(write_file_atomically(figures_file(arguments_, kFiguresCsv),
                                     session_report_csv(json), Readers::kOwner));
  }
  // The last line is what the console shows.
  if (report.recording_error) errors.push_back(*report.recording_error);
  return errors;
}

}  // namespace trocar::runtime
