// SPDX-License-Identifier: Apache-2.0
#include "runtime/program/run_arguments.h"

#include <unistd.h>

#include <array>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <limits>
#include <system_error>

#include "formats/base/file_io.h"
#include "formats/base/terminal_text.h"
#include "formats/session/procedures.h"
#include "formats/session/scene.h"

namespace trocar::runtime {
namespace {

Result<void> check_procedure(const RunArguments& a) {
  if (!a.procedure.empty() && find_procedure(a.procedure) == nullptr)
    return usage("--procedure " + a.procedure + ": must be one of " + procedure_names());
  if (!a.strength.empty() && a.procedure.empty()) return usage("--strength: is for --procedure");
  if (!a.procedure.empty() && !a.force_law.empty() && a.force_law != "cutting")
    return usage("--force-law " + a.force_law + ": a procedure is for the force law cutting");
  if (!a.procedure.empty() && !a.new_scene.empty())
    return usage("--procedure: is for a scene; leave --new-scene out");
  if (a.explain && !(a.scene.empty() && a.new_scene.empty()))
    return usage("--explain: runs no session; leave the scene out");
  return {};
}

Result<void> check_trainee(const RunArguments& a) {
  if (const std::string why = trainee_code_error(a.trainee.code); !why.empty())
    return usage("--trainee " + a.trainee.code + ": " + why);
  if (const std::string why = trainee_code_error(a.trainee.course); !why.empty())
    return usage("--course " + a.trainee.course + ": " + why);
  if (a.trainee.attempt)
    if (const std::string why = attempt_error(*a.trainee.attempt); !why.empty())
      return usage("--attempt: " + why);
  if (a.trainee.is_stated() && !a.replay.empty())
    return usage(
        "--replay: trainee, course and attempt are the recording's; leave --trainee, --course and "
        "--attempt out");
  return {};
}

bool is_html_name(const std::filesystem::path& file) {
  return file.extension() == ".html" && !file.stem().empty();
}

Result<void> check_history(const RunArguments& a) {
  if (!a.scene.empty() || !a.new_scene.empty())
    return usage("--history: runs no session; leave the scene out");
  if (a.output.empty()) return usage("--history: needs -o NAME.html, the page to write");
  if (!is_html_name(a.output))
    return usage("-o " + a.output + ": must be a name that ends in .html");
  return {};
}

/// Reads a point such as "-12.5,3,40".
Result<std::array<double, 3>> read_point(const std::string& option, const std::string& text) {
  constexpr double kMost_mm = 1e4;
  const std::string why =
      option + " " + text + ": must be three numbers X,Y,Z: mm in the patient's frame, DICOM's LPS";
  std::array<double, 3> point{};
  const char *at = text.data(), *const last = at + text.size();
  for (std::size_t i = 0; i < point.size(); ++i) {
    const auto [end, error] = std::from_chars(at, last, point[i]);
    const bool ends_well = i + 1 < point.size() ? end != last && *end == ',' : end == last;
    if (error != std::errc() || !ends_well || !(std::abs(point[i]) <= kMost_mm)) return usage(why);
    at = end + (end != last ? 1 : 0);
  }
  return point;
}

Result<void> check_new_scene(const RunArguments& a) {
  if (a.new_scene.empty()) return {};
  if (!a.scene.empty()) return usage("--new-scene: makes a scene; leave " + a.scene + " out");
  if (a.output.empty()) return usage("--new-scene: needs -o SCENE.json, the file to write");
  const auto points = chosen_points(a);
  return points ? Result<void>() : points.error();
}

Result<void> check_simulated(const RunArguments& a) {
  if (!a.simulated || is_device_process(a.device)) return {};
  if (!may_have_motors(a.device))
    return usage("--simulated: is for a device process; " + a.device + " is always simulated");
  return usage("--simulated: is for a device process; " + a.device +
               " has motors. For a program that stands in for it, allow late ticks by "
               "--late-ticks-in-row 0");
}

Result<void> check_scene_arguments(const RunArguments& a) {
  if (a.new_scene.empty() && !a.entry.empty()) return usage("--entry: is for --new-scene");
  if (a.entry.empty() && !a.target.empty())
    return usage("--target: needs --entry, the point where the needle enters");
  if (auto good = check_procedure(a); !good) return good;
  if (a.explain) return {};
  if (!a.history.empty()) return check_history(a);
  if (a.test_device) {
    if (!a.scene.empty() || !a.new_scene.empty())
      return usage("--test: runs no session; leave the scene out");
    if (!may_have_motors(a.device))
      return usage("--test: is for a device process; " + a.device + " has nothing to test");
    return {};
  }
  if (a.scene.empty() && a.new_scene.empty())
    return usage("SCENE is required (see trocar-run --help)");
  if (auto good = check_new_scene(a); !good) return good;
  if (a.new_scene.empty() && !a.output.empty())
    return usage("-o: is for --new-scene and --history");
  if (a.new_scene.empty() && a.live_hand)
    return usage("--live-hand: is for --new-scene; in a scene, `hand` has `live`");
  return {};
}

}  // namespace

Result<void> check_run_arguments(const RunArguments& a) {
  if (const Result<void> good = check_scene_arguments(a); !good) return good.error();
  if (const Result<void> good = check_trainee(a); !good) return good.error();
  const Result<void> device = check_device_uri(a.device, !a.key_file.empty());
  if (!device) return device.error();
  if (!a.replay.empty() && a.device != kDefaultDevice) {
    return usage("--replay: has no device; leave --device out");
  }
  if (a.xray && a.live.empty())
    return usage("--xray: needs --live, by which other programs take pictures");
  if (!a.force_law.empty() && !force_law_from_string(a.force_law)) {
    return usage("--force-law " + a.force_law + ": must be " + force_law_names());
  }
  if (const Result<void> good = check_simulated(a); !good) return good.error();
  if (a.recover == "auto" && may_have_motors(a.device) &&
      !(a.simulated && is_device_process(a.device)))
    return usage("--recover auto: would let forces return by itself, and " + a.device +
                 " may have motors; use --recover signal" +
                 (is_device_process(a.device) ? ", or --simulated if it has none" : ""));
  if (a.strict && !a.check) return usage("--strict: is for --check");
  if (const long processors = ::sysconf(_SC_NPROCESSORS_CONF);
      a.cpu < -1 || (processors > 0 && a.cpu >= processors)) {
    return usage("--cpu " + std::to_string(a.cpu) + ": must be within 0 and " +
                 std::to_string(processors - 1) + ", the processors of this machine");
  }
  if (!a.session_report.empty() && !is_html_name(a.session_report))
    return usage("--session-report " + a.session_report + ": must be a name that ends in .html");
  if (a.late_ticks_in_row && *a.late_ticks_in_row < 0)
    return usage("--late-ticks-in-row: must not be negative");
  if (!a.replay.empty() && (a.rate_Hz || a.duration_s)) {
    return usage(
        "--replay: rate and duration are the recording's; leave --rate and --duration out");
  }
  return {};
}

namespace {

/// The folder of the recording, or else the current folder, or else the one for temporary files.
std::filesystem::path default_black_box(const RunArguments& arguments) {
  if (!arguments.record.empty()) {
    const std::filesystem::path folder = std::filesystem::path(arguments.record).parent_path();
    return folder.empty() ? "." : folder;
  }
  if (check_writable("./black_box")) return ".";
  std::error_code failed;
  std::filesystem::path temporary = std::filesystem::temp_directory_path(failed);
  if (failed) return ".";
  if (!arguments.quiet)
    print(stderr,
          "trocar-run: note: the current folder cannot be written to; a black box would go "
          "to %s\n",
          temporary);
  return temporary;
}

/// Returns the longest time without a new device state that a session with these arguments allows.
double no_data_max_s(const RunArguments& arguments) {
  const bool may_stall = arguments.simulated && arguments.late_ticks_in_row.value_or(0) == 0 &&
                         arguments.clock == "real";
  return may_stall ? kSimulatedNoData_s : SafetyLimits{}.no_data_max_s;
}

}  // namespace

Result<std::optional<ChosenPoints>> chosen_points(const RunArguments& a) {
  if (a.entry.empty()) return std::optional<ChosenPoints>();
  ChosenPoints points;
  const auto entry = read_point("--entry", a.entry);
  if (!entry) return entry.error();
  points.entry_mm = *entry;
  if (a.target.empty()) return std::optional(points);
  const auto target = read_point("--target", a.target);
  if (!target) return target.error();
  points.target_mm = *target;
  return std::optional(points);
}

void set_loop_options(const RunArguments& arguments, SessionOptions& options) {
  const bool is_simulated = !may_have_motors(arguments.device) || arguments.simulated;
  options.recovery = arguments.recover == "auto"     ? RecoveryPolicy::kAuto
                     : arguments.recover == "signal" ? RecoveryPolicy::kOnRequest
                                                     : RecoveryPolicy::kNever;
  options.passivity.on = arguments.passivity == "on";
  options.limits.energy_limit_J = arguments.energy_limit_J.value_or(options.limits.energy_limit_J);
  options.stiffness.margin = is_simulated ? 1 : kHardwareMargin;
  options.stiffness.max_N_per_m =
      arguments.stiffness_limit_N_per_m.value_or(options.stiffness.max_N_per_m);
  options.coupling.on = arguments.coupling_N_per_m.has_value();
  const CouplingOptions usual;
  const double coupling_N_per_m = arguments.coupling_N_per_m.value_or(usual.stiffness_N_per_m);
  options.coupling.stiffness_N_per_m = coupling_N_per_m;
  // The damping is in proportion, or a soft coupling would be stiff within a tick.
  options.coupling.damping_N_s_per_m =
      coupling_N_per_m / usual.stiffness_N_per_m * usual.damping_N_s_per_m;
  options.compensation.friction =
      arguments.compensate == "friction" || arguments.compensate == "both";
  options.compensation.gravity = arguments.compensate == "weight" || arguments.compensate == "both";
  options.cpu = arguments.cpu;
  const int late_ticks = arguments.late_ticks_in_row.value_or(is_simulated ? 0 : kDefaultLateTicks);
  options.limits.missed_deadlines_max =
      late_ticks > 0 ? late_ticks - 1 : std::numeric_limits<int>::max();
  // A simulated device process is not harmed by a gap or a stall either, but a leap of its clock
  // stays a fault. (The device in the process has none.)
  if (arguments.simulated && late_ticks == 0) options.limits.gap_max_s = 0;
  options.limits.no_data_max_s = no_data_max_s(arguments);
  if (!arguments.black_box.empty()) {
    options.black_box = arguments.black_box;
  } else if (arguments.replay.empty() && arguments.runs_session()) {
    options.black_box = default_black_box(arguments);
  }
}

}  // namespace trocar::runtime
