// SPDX-License-Identifier: Apache-2.0
// trocar-run: runs a session of the haptic loop over a scene. Here are the command line and the
// outputs; the session itself is runtime/session/session.h.
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <limits>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "formats/asset/asset.h"
#include "formats/asset/one_sheet.h"
#include "formats/base/command_line.h"
#include "formats/base/file_io.h"
#include "formats/base/json_text.h"
#include "formats/session/scene.h"
#include "runtime/library_versions.h"
#include "runtime/session/display.h"
#include "runtime/session/new_scene.h"
#include "runtime/session/open_device.h"
#include "runtime/session/origin.h"
#include "runtime/session/replay_device.h"
#include "runtime/session/scene_check.h"
#include "runtime/session/session.h"
#include "runtime/session/session_report.h"
#include "runtime/session/summary.h"
#include "runtime/session/tissue_report.h"

namespace trocar::runtime {
namespace {

constexpr double kDefaultRate_Hz = 1000;

std::atomic<bool> recovery_requested{false};

void request_recovery(int) {
  recovery_requested.store(true);
}

constexpr const char* kName = "trocar-run";
constexpr int kProgressWidth = 72;

struct Arguments {
  std::string new_scene, output;
  std::string scene, asset, device{kDefaultDevice}, key_file, description, clock = "real",
                                                                           force_law;
  std::optional<double> rate_Hz, duration_s;
  std::string record, summary, replay, meshes, frames, live, session_report;
  std::string black_box, recover = "never", passivity = "on", compensate = "none";
  std::optional<double> coupling_N_per_m, energy_budget_J;
  int cpu = -1, late_ticks = 3;
  bool check = false, strict = false, quiet = false;
};

int fail(const Error& error) {
  return report_error(kName, error);
}

std::string version() {
  return "trocar-run " TROCAR_VERSION " (" + library_versions() +
         ", Draco and tinygltf for assets)";
}

void declare(CLI::App& app, Arguments& arguments) {
  add_help_and_version(app, version());
  app.add_option(
      "SCENE", arguments.scene,
      "the scene, JSON (formats/session/scene.schema.json); needed but with --new-scene");
  app.add_option("--new-scene", arguments.new_scene,
                 "propose a scene for this asset (.glb) and write it to -o: no session");
  app.add_option("-o,--output", arguments.output, "with --new-scene: the scene's file, JSON");
  app.add_option("--device", arguments.device,
                 device_uri_help() + " (" + std::string(kDefaultDevice) + ")");
  app.add_option("--key-file", arguments.key_file,
                 "the key of the link to a device process: the file that it was started with");
  app.add_option("--clock", arguments.clock,
                 "real: wall clock; virtual: as fast as possible, deterministic (real)");
  app.add_option("--rate", arguments.rate_Hz,
                 "loop rate in Hz, 100 to 8000 (the scene's, or 1000)");
  app.add_option("--duration", arguments.duration_s, "in s (the scene's)");
  app.add_option(
      "--record", arguments.record,
      "write a recording: CSV, one row a tick; until it is whole its name ends in .partial");
  app.add_option("--summary", arguments.summary, "write what happened: JSON");
  app.add_option(
      "--session-report", arguments.session_report,
      "write a page on the session for the talk afterwards, NAME.html, and its figures,\n"
      "NAME.json: path, forces, punctures, plunges, tremor, and the scene's goals");
  app.add_option("--meshes", arguments.meshes,
                 "write the sheets before and after the punctures: JSON");
  app.add_option("--frames", arguments.frames,
                 "write the sheet around the tool 30 times a second: JSON lines");
  app.add_option("--live", arguments.live,
                 "show the session to other programs, and take their commands: a link to memory\n"
                 "that is there while the session runs");
  app.add_option("--replay", arguments.replay,
                 "run on a recording's inputs (virtual clock), compare the torques; exit code 3\n"
                 "if they differ, or if scene, asset, device or options are not the recorded ones");
  app.add_option("--asset", arguments.asset, "an asset (.glb) instead of the scene's");
  app.add_option("--device-description", arguments.description,
                 "a device description (JSON) instead of the scene's");
  app.add_option("--force-law", arguments.force_law,
                 force_law_names() + ", instead of the scene's");
  app.add_option("--black-box", arguments.black_box,
                 "folder for the last 4 s before each fault (that of --record, or this one)");
  app.add_option("--recover", arguments.recover,
                 "after a fault: never: end the session; auto; signal: on SIGUSR1 (never)");
  app.add_option("--late-ticks", arguments.late_ticks,
                 "deadlines missed in a row that are a fault; 0: none (3; inproc: none)");
  app.add_option("--passivity", arguments.passivity, "the passivity controller: on or off (on)");
  app.add_option("--energy-budget", arguments.energy_budget_J,
                 "energy in J that the hand may get within 0.1 s beyond what the sheets stored; "
                 "more is the fault energy (0.05)");
  app.add_option("--coupling", arguments.coupling_N_per_m,
                 "stiffness of a virtual coupling, N/m (none: the tool itself touches the sheets)");
  app.add_option("--compensate", arguments.compensate,
                 "torques that cancel the device's own: none, friction, weight or both (none)");
  app.add_option("--cpu", arguments.cpu, "the processor that the loop stays on (any)");
  app.add_flag("--check", arguments.check,
               "judge the scene instead: what it needs, where its hand can go, what a trial with\n"
               "the simulated device does, and warnings of what ends it or touches nothing");
  app.add_flag("--strict", arguments.strict, "with --check: exit code 3 after a warning");
  app.add_flag("--quiet", arguments.quiet, "print errors only");
  app.footer(
      "Exit codes: 0 done; 2 wrong usage; 3 input refused; 4 could not be written; 5 stopped by\n"
      "a fault; 1 a bug. Ctrl-C ends a session with torques at zero and its files written.");
}

Result<void> check_arguments(const Arguments& a) {
  if (a.scene.empty() && a.new_scene.empty())
    return usage("SCENE is required (see trocar-run --help)");
  if (!a.scene.empty() && !a.new_scene.empty())
    return usage("--new-scene: makes a scene; leave " + a.scene + " out");
  if (!a.new_scene.empty() && a.output.empty())
    return usage("--new-scene: needs -o SCENE.json, the file to write");
  if (a.new_scene.empty() && !a.output.empty()) return usage("-o: is for --new-scene");
  const Result<void> device = check_device_uri(a.device, !a.key_file.empty());
  if (!device) return device.error();
  if (!a.replay.empty() && a.device != kDefaultDevice) {
    return usage("--replay: has no device; leave --device out");
  }
  if (a.clock != "real" && a.clock != "virtual") {
    return usage("--clock " + a.clock + ": must be real or virtual");
  }
  if (!a.force_law.empty() && !force_law_from_string(a.force_law)) {
    return usage("--force-law " + a.force_law + ": must be " + force_law_names());
  }
  // Written so that nan is refused too.
  if (a.rate_Hz && !(*a.rate_Hz >= kMinRate_Hz && *a.rate_Hz <= kMaxRate_Hz)) {
    return usage("--rate: must be within 100 and 8000 Hz");
  }
  if (a.duration_s && !(*a.duration_s >= 1e-3 && *a.duration_s <= kMaxDuration_s)) {
    return usage("--duration: must be within 0.001 and 86400 s");
  }
  if (a.recover != "never" && a.recover != "auto" && a.recover != "signal") {
    return usage("--recover " + a.recover + ": must be never, auto or signal");
  }
  if (a.passivity != "on" && a.passivity != "off") {
    return usage("--passivity " + a.passivity + ": must be on or off");
  }
  if (a.compensate != "none" && a.compensate != "friction" && a.compensate != "weight" &&
      a.compensate != "both") {
    return usage("--compensate " + a.compensate + ": must be none, friction, weight or both");
  }
  if (a.coupling_N_per_m && !(*a.coupling_N_per_m >= 100 && *a.coupling_N_per_m <= 1e6)) {
    return usage("--coupling: must be within 100 and 1000000 N/m");
  }
  if (a.energy_budget_J && !(*a.energy_budget_J >= 1e-3 && *a.energy_budget_J <= 10)) {
    return usage("--energy-budget: must be within 0.001 and 10 J");
  }
  if (a.strict && !a.check) return usage("--strict: is for --check");
  if (const long processors = ::sysconf(_SC_NPROCESSORS_CONF);
      a.cpu < -1 || (processors > 0 && a.cpu >= processors)) {
    return usage("--cpu " + std::to_string(a.cpu) + ": must be within 0 and " +
                 std::to_string(processors - 1) + ", the processors of this machine");
  }
  if (!a.session_report.empty() &&
      (std::filesystem::path(a.session_report).extension() != ".html" ||
       std::filesystem::path(a.session_report).stem().empty()))
    return usage("--session-report " + a.session_report + ": must be a name that ends in .html");
  if (a.late_ticks < 0) return usage("--late-ticks: must not be negative");
  if (!a.replay.empty() && (a.rate_Hz || a.duration_s)) {
    return usage(
        "--replay: rate and duration are the recording's; leave --rate and --duration out");
  }
  return {};
}

struct Loaded {
  Scene scene;
  DeviceDescription description;
  std::vector<std::unique_ptr<const Sheet>> sheets;
  std::vector<SliceTissue> tissues;  ///< of the sheets
  std::vector<RecordingRow> replay;
  RecordingOrigin replay_origin;
  LoadedBytes bytes;
};

Result<Loaded> load(const Arguments& arguments) {
  Loaded loaded;
  Result<Scene> scene = read_scene(arguments.scene);
  if (!scene) return scene.error();
  loaded.scene = std::move(*scene);
  if (!arguments.asset.empty()) loaded.scene.asset = arguments.asset;
  if (const auto law = force_law_from_string(arguments.force_law))
    loaded.scene.force_law.kind = *law;
  if (arguments.coupling_N_per_m) {
    loaded.scene.force_law.axis = ToolAxis::kCoupled;
    loaded.scene.force_law.coupling_N_per_m = *arguments.coupling_N_per_m;
  }
  if (!arguments.description.empty()) loaded.scene.device = arguments.description;

  loaded.description = default_device_description();
  if (loaded.scene.device) {
    Result<DeviceDescription> description = read_device_description(loaded.scene.device->string());
    if (!description) return description.error();
    loaded.description = std::move(*description);
  }

  if (loaded.scene.body && loaded.scene.force_law.kind != ForceLawKind::kCutting)
    return refused(arguments.scene + ": has a body, which is for the force law cutting");
  std::vector<int> slice_indices;
  for (const SceneSlice& slice : loaded.scene.slices)
    slice_indices.push_back(slice.index);
  if (const auto& body = loaded.scene.body) {
    for (int index = body->from; index <= body->to; ++index)
      slice_indices.push_back(index);
  }
  Result<AssetPart> part = read_asset_part(loaded.scene.asset, std::move(slice_indices));
  if (!part) {
    std::error_code ignored;
    const bool is_elsewhere =
        arguments.asset.empty() && !std::filesystem::exists(loaded.scene.asset, ignored);
    return Error{
        part.error().code,
        part.error().message + (is_elsewhere ? " (the scene's asset; --asset names another)" : "")};
  }
  const std::string asset = loaded.scene.asset.string();
  if (const auto ok = weld_materials(part->asset, asset); !ok) return ok.error();
  if (const auto ok = place_body(loaded.scene, part->asset, asset); !ok) return ok.error();
  auto sheets = place_slices(loaded.scene, part->asset, asset);
  if (!sheets) return sheets.error();
  loaded.sheets = std::move(*sheets);
  loaded.tissues = choose_tissues(loaded.scene, part->asset);
  loaded.bytes = {part->file_bytes, part->read_bytes, part->asset_slices};

  if (!arguments.replay.empty()) {
    Result<std::vector<RecordingRow>> rows =
        read_recording(arguments.replay, &loaded.replay_origin);
    if (!rows) return rows.error();
    loaded.replay = std::move(*rows);
  }
  return loaded;
}

void print_outcome(const SessionReport& report, const SessionOptions& options) {
  std::printf(
      "%llu ticks at %.6g Hz, %llu missed deadlines, largest force %.3f N, largest torque "
      "%.3f Nm\n",
      static_cast<unsigned long long>(report.ticks), options.rate_Hz,
      static_cast<unsigned long long>(report.realtime.missed_deadlines), report.max_force_N,
      report.torque_max_Nm);
  constexpr double kLeastShown_N = 5e-4;
  if (report.max_force_N < kLeastShown_N && report.punctures.empty() &&
      report.fault == Fault::kNone)
    std::printf("the tool touched nothing; trocar-run --check says why\n");
  for (const PunctureEvent& event : report.punctures) {
    std::printf("slice %d was punctured at %.4f s: force %.3f N, depth %.3f mm, tip at %.5f m\n",
                event.slice, event.t_s, event.force_N, event.penetration_m * 1e3, event.tool_z_m);
  }
  if (!options.replay.empty() && report.replay_first_difference < 0 &&
      report.ticks == options.replay.size()) {
    std::printf("replay: all torques identical to the recording's\n");
  }
}

/// One line, at once, also into a file. On a terminal it takes the place of the progress line.
void tell(const Arguments& arguments, const Notice& notice) {
  std::string line = kName + std::string(": ") + describe(notice);
  if (notice.kind == Notice::Kind::kFault && arguments.recover == "signal" &&
      arguments.replay.empty())
    line += "; then ask for recovery: kill -USR1 " + std::to_string(::getpid());
  if (::isatty(STDERR_FILENO) != 0) std::fprintf(stderr, "\r%*s\r", kProgressWidth, "");
  std::fprintf(stderr, "%s\n", line.c_str());
  std::fflush(stderr);
}

/// A line on the terminal while a session in real time runs.
class Progress {
 public:
  Progress(TripleBuffer<RecordingRow>& live, double duration_s)
      : thread_([this, &live, duration_s] {
          RecordingRow row;
          while (!done_.load()) {
            std::this_thread::sleep_for(std::chrono::milliseconds(100));
            if (!live.read(row)) continue;
            std::fprintf(stderr, "\r%7.2f of %.2f s  tip %8.4f m  force %6.2f N  %-10s", row.t_s,
                         duration_s, row.tool_m[2], row.wrench_wanted[2], to_string(row.phase));
          }
          std::fprintf(stderr, "\r%*s\r", kProgressWidth, "");
        }) {}
  ~Progress() {
    done_.store(true);
    thread_.join();
  }
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

 private:
  std::atomic<bool> done_{false};
  std::thread thread_;
};

/// Calls run(), with progress on the terminal if there is one and the session runs in real time.
template <typename Run>
Result<SessionReport> watched(const Arguments& arguments, SessionOptions& options, Run&& run) {
  TripleBuffer<RecordingRow> live;
  std::optional<Progress> progress;
  if (options.clock == Clock::kReal && !arguments.quiet && ::isatty(STDERR_FILENO) != 0) {
    options.live = &live;
    progress.emplace(live, options.duration_s);
  }
  Result<SessionReport> report = run();
  options.live = nullptr;
  return report;
}

/// The summary's "link": how many packets were accepted, and how many refused for which reason.
nlohmann::json describe(const LinkReport& link) {
  nlohmann::json refused = nlohmann::json::object();
  for (std::size_t i = 1; i < kLinkRefusals; ++i) {
    refused[to_string(static_cast<LinkRefusal>(i))] = link.packets.by_refusal[i];
  }
  return {{"sessions", link.sessions},
          {"packets_accepted", link.packets.accepted()},
          {"packets_refused", refused},
          {"states_missed", link.states_missed}};
}

/// `link` gets the report of the device's link, if it has one.
Result<SessionReport> run(const Arguments& arguments, const Loaded& loaded, Remesher& remesher,
                          SessionOptions& options, std::optional<LinkReport>& link) {
  if (!loaded.replay.empty()) {
    ReplayDevice device(loaded.replay);
    return run_session(
        loaded.scene, loaded.description, remesher, device, [](double) {}, options);
  }
  Result<std::unique_ptr<Device>> opened =
      open_device(arguments.device, {.scene = loaded.scene,
                                     .scene_name = arguments.scene,
                                     .description = loaded.description,
                                     .key_file = arguments.key_file,
                                     .clock = options.clock,
                                     .rate_Hz = options.rate_Hz});
  if (!opened) return opened.error();
  Device& device = **opened;
  if (device.is_paced_by_loop()) options.limits.gap_max_s = 0;
  // Before start(), since a drive behind a link ends a session in which no tick comes.
  Result<SessionWorkers> workers =
      make_workers(loaded.scene, loaded.description, remesher, options);
  if (!workers) return workers.error();
  if (Result<void> started = device.start(); !started) return started.error();
  Result<SessionReport> report = watched(arguments, options, [&] {
    return run_session(
        loaded.scene, loaded.description, remesher, device,
        [&device](double dt_s) { device.advance(dt_s); }, options, std::move(*workers));
  });
  device.close();
  link = device.link_report();
  if (link && link->restore_error) {
    std::fprintf(stderr, "trocar-run: the link was not restored: %s\n",
                 link->restore_error->message.c_str());
  }
  return report;
}

/// The options of the safety layer and of the loop.
void set_loop_options(const Arguments& arguments, SessionOptions& options) {
  options.recovery = arguments.recover == "auto"     ? RecoveryPolicy::kAuto
                     : arguments.recover == "signal" ? RecoveryPolicy::kOnRequest
                                                     : RecoveryPolicy::kNever;
  options.recover = &recovery_requested;
  options.passivity.on = arguments.passivity == "on";
  options.limits.energy_given_max_J =
      arguments.energy_budget_J.value_or(options.limits.energy_given_max_J);
  options.coupling.on = arguments.coupling_N_per_m.has_value();
  options.coupling.stiffness_N_per_m =
      arguments.coupling_N_per_m.value_or(options.coupling.stiffness_N_per_m);
  options.compensation.friction =
      arguments.compensate == "friction" || arguments.compensate == "both";
  options.compensation.gravity = arguments.compensate == "weight" || arguments.compensate == "both";
  options.cpu = arguments.cpu;
  options.limits.missed_deadlines_max =
      arguments.late_ticks > 0 ? arguments.late_ticks - 1 : std::numeric_limits<int>::max();
  if (!arguments.black_box.empty()) {
    options.black_box = arguments.black_box;
  } else if (arguments.replay.empty()) {
    options.black_box = std::filesystem::path(arguments.record).parent_path();
    if (options.black_box->empty()) options.black_box = ".";
  }
}

/// Prints a line for each black box. False: one could not be written.
bool print_black_boxes(const SessionReport& report) {
  bool written = report.black_boxes_lost == 0;
  for (const BlackBoxFile& box : report.black_boxes) {
    if (box.error) {
      std::fprintf(stderr, "trocar-run: black box: %s\n", box.error->message.c_str());
      written = false;
    } else {
      std::fprintf(stderr, "trocar-run: black box: %s\n", box.file.c_str());
    }
  }
  return written;
}

/// The figures beside a session's page.
std::filesystem::path figures_file(const Arguments& arguments) {
  return arguments.session_report.empty()
             ? std::filesystem::path()
             : std::filesystem::path(arguments.session_report).replace_extension(".json");
}

std::vector<ReportSheet> report_sheets(const Loaded& loaded) {
  std::vector<ReportSheet> sheets;
  sheets.reserve(loaded.sheets.size());
  for (std::size_t i = 0; i < loaded.sheets.size(); ++i)
    sheets.push_back({loaded.sheets[i]->slice_index, loaded.sheets[i]->z_m,
                      i < loaded.tissues.size() ? loaded.tissues[i].choice.name : ""});
  return sheets;
}

/// Page and figures; both are tried.
std::vector<Result<void>> write_session_report(const Arguments& arguments, const Loaded& loaded,
                                               const SessionOptions& options,
                                               const SessionReport& report,
                                               const Remesher& remesher,
                                               std::vector<ReportSheet> sheets,
                                               SessionObserver& observer) {
  const SessionFigures figures = observer.figures();
  ReportFacts facts;
  facts.asset = without_folder(loaded.scene.asset.filename());
  facts.force_law = to_string(loaded.scene.force_law.kind);
  facts.is_virtual = options.clock == Clock::kVirtual || !options.replay.empty();
  facts.end = report.end;
  facts.lost_ticks = report.ticks_not_seen;
  facts.faults = report.faults;
  facts.sheets = std::move(sheets);
  for (const int axis : {0, 1}) {
    for (std::size_t i = 0; i < remesher.size(); ++i)
      facts.material_m[static_cast<std::size_t>(axis)].push_back(material_along(
          remesher.first_version(i), axis, figures.lowest_m[static_cast<std::size_t>(1 - axis)]));
  }
  return {write_file_atomically(arguments.session_report,
                                session_report_page(loaded.scene, figures, facts)),
          write_file_atomically(figures_file(arguments),
                                session_report_json(loaded.scene, figures, facts) + "\n")};
}

/// Writes every output, also after another could not be written. Returns the errors.
std::vector<Error> write_outputs(const Arguments& arguments, const Loaded& loaded,
                                 const SessionOptions& options, const SessionReport& report,
                                 const Remesher& remesher, const std::optional<LinkReport>& link,
                                 const FrameWriter& frames) {
  std::vector<Error> errors;
  const auto keep_error = [&](const Result<void>& done) {
    if (!done) errors.push_back(done.error());
  };
  if (report.recording_error) errors.push_back(*report.recording_error);
  if (!arguments.summary.empty()) {
    const std::string text =
        summarize(loaded.scene, options, report, remesher, link ? json_text(describe(*link)) : "");
    keep_error(write_file_atomically(arguments.summary, text + "\n"));
  }
  if (!arguments.meshes.empty()) {
    const std::string text = describe_sheets(loaded.scene, remesher) + "\n";
    keep_error(write_file_atomically(arguments.meshes, text));
  }
  if (!arguments.frames.empty()) keep_error(frames.finish());
  return errors;
}

/// The first hole that could not be cut; later ones in the same sheet fail because of it.
std::optional<Error> failed_hole(const SessionReport& report, const Remesher& remesher) {
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

/// Prints a line for each problem of a session and returns the exit code. A fault's exit code takes
/// precedence, since the operator of the device must know of it; in a replay, which has no device,
/// that of torques that differ.
int conclude(const SessionReport& report, std::vector<Error> errors, const Remesher& remesher) {
  if (const std::optional<Error> hole = failed_hole(report, remesher)) errors.push_back(*hole);
  const bool black_boxes_written = print_black_boxes(report);
  int code = black_boxes_written ? 0 : static_cast<int>(ExitCode::kUnwritable);
  for (const Error& error : errors) {
    const int error_code = fail(error);
    if (code == 0) code = error_code;
  }
  const bool has_failed = report.end == SessionEnd::kFault;
  if (has_failed) {
    std::fprintf(stderr, "trocar-run: stopped at %.4f s by the fault %s\n", report.fault_t_s,
                 to_string(report.fault));
  }
  if (report.replay_first_difference >= 0) {
    return fail(refused("the torques differ from the recording's from row " +
                        std::to_string(report.replay_first_difference + 1) + " on"));
  }
  if (!has_failed) return code;
  return static_cast<int>(ExitCode::kDeviceFault);
}

void warn(const Arguments& arguments, const std::string& what) {
  std::fprintf(stderr, "trocar-run: warning: %s: %s\n", arguments.scene.c_str(), what.c_str());
}

/// The replay is of what the recording has, which may be less than the session.
void warn_of_short(const Arguments& arguments, std::size_t rows, std::uint64_t session_ticks) {
  if (arguments.quiet || rows >= session_ticks) return;
  std::fprintf(
      stderr,
      "trocar-run: warning: %s: has %zu ticks, and the scene lasts %llu: its session ended "
      "early, or a part is missing\n",
      arguments.replay.c_str(), rows, static_cast<unsigned long long>(session_ticks));
}

/// --check.
int check(const Arguments& arguments, const Loaded& loaded, const SessionOptions& options) {
  const Result<SceneCheck> checked = check_scene(loaded.scene, loaded.description, loaded.sheets,
                                                 loaded.tissues, loaded.bytes, options);
  if (!checked) return fail(checked.error());
  if (!arguments.quiet) std::fputs(checked->text.c_str(), stdout);
  for (const std::string& warning : checked->warnings)
    warn(arguments, warning);
  if (!arguments.strict || checked->warnings.empty()) return 0;
  return fail(refused(arguments.scene + ": " + std::to_string(checked->warnings.size()) +
                      (checked->warnings.size() == 1 ? " warning" : " warnings") +
                      ", and --strict allows none"));
}

/// --new-scene.
int make_scene(const Arguments& arguments) {
  const OutputFile outputs[] = {{"-o", arguments.output}};
  const std::filesystem::path inputs[] = {arguments.new_scene, arguments.description};
  if (const Result<void> good = check_outputs(outputs, inputs); !good) return fail(good.error());
  DeviceDescription description = default_device_description();
  if (!arguments.description.empty()) {
    Result<DeviceDescription> given = read_device_description(arguments.description);
    if (!given) return fail(given.error());
    description = std::move(*given);
  }
  Result<Asset> asset = read_asset(arguments.new_scene);
  if (!asset) return fail(asset.error());
  if (const auto ok = weld_materials(*asset, arguments.new_scene); !ok) return fail(ok.error());
  SessionOptions options;
  options.clock = Clock::kVirtual;
  options.rate_Hz = arguments.rate_Hz.value_or(kDefaultRate_Hz);
  options.stop = &stop_requested;
  set_loop_options(arguments, options);
  const Result<NewScene> made =
      propose_scene(*asset, arguments.new_scene, arguments.output, description, options);
  if (!made) return fail(made.error());
  if (const auto written = write_file_atomically(arguments.output, made->json); !written)
    return fail(written.error());
  if (!arguments.quiet) std::fputs(made->text.c_str(), stdout);
  return 0;
}

int session(const Arguments& arguments) {
  Result<Loaded> loaded = load(arguments);
  if (!loaded) return fail(loaded.error());
  const OutputFile outputs[] = {{"--record", arguments.record},
                                {"--summary", arguments.summary},
                                {"--meshes", arguments.meshes},
                                {"--frames", arguments.frames},
                                {"--session-report", arguments.session_report},
                                {"--session-report (its figures)", figures_file(arguments)}};
  for (const OutputFile& output : outputs) {
    if (!arguments.live.empty() && output.file == arguments.live)
      return fail(usage("--live " + arguments.live + ": is also the file of " + output.option));
  }
  const std::filesystem::path inputs[] = {arguments.scene, loaded->scene.asset,
                                          loaded->scene.device.value_or(""), arguments.replay,
                                          arguments.key_file};
  if (const Result<void> good = check_outputs(outputs, inputs); !good) return fail(good.error());

  SessionOptions options;
  options.clock = arguments.clock == "real" ? Clock::kReal : Clock::kVirtual;
  options.rate_Hz = arguments.rate_Hz.value_or(loaded->scene.rate_Hz.value_or(kDefaultRate_Hz));
  options.duration_s = arguments.duration_s.value_or(loaded->scene.duration_s);
  if (!loaded->replay.empty()) {
    const Result<double> rate_Hz =
        recorded_rate_Hz(loaded->replay, arguments.replay, stated_rate_Hz(loaded->replay_origin));
    if (!rate_Hz) return fail(rate_Hz.error());
    options.rate_Hz = *rate_Hz;
    options.duration_s = static_cast<double>(loaded->replay.size()) / *rate_Hz;
    warn_of_short(arguments, loaded->replay.size(), tick_count(loaded->scene.duration_s, *rate_Hz));
    options.replay = loaded->replay;
  }
  if (!arguments.record.empty()) options.record = arguments.record;
  options.on_recording_error = [](const Error& error) {
    std::fprintf(stderr, "trocar-run: the recording has stopped: %s\n", error.message.c_str());
  };
  options.on_notice = [&arguments](const Notice& notice) { tell(arguments, notice); };
  options.stop = &stop_requested;
  set_loop_options(arguments, options);
  if (arguments.check) return check(arguments, *loaded, options);
  const std::optional<std::string> unfitting = warn_of_unfitting(loaded->scene, loaded->tissues);
  if (unfitting && !arguments.quiet) warn(arguments, *unfitting);

  const Result<RecordingOrigin> origin =
      make_origin(arguments.scene, loaded->scene, loaded->description, options);
  if (!origin) return fail(origin.error());
  options.origin = *origin;
  if (!loaded->replay.empty()) {
    const Result<std::string> warning =
        check_replay(loaded->replay_origin, *origin, arguments.replay);
    if (!warning) return fail(warning.error());
    if (!warning->empty()) std::fprintf(stderr, "trocar-run: warning: %s\n", warning->c_str());
  }

  if (!arguments.live.empty()) {
    options.live_memory = {arguments.live,
                           arguments.scene,
                           loaded->replay.empty() ? arguments.device : "replay",
                           arguments.recover,
                           {}};
    for (const SliceTissue& slice : loaded->tissues)
      options.live_memory->tissue_of_sheet.push_back(slice.choice.name);
  }
  FrameWriter frames(arguments.frames);
  if (!arguments.frames.empty()) {
    options.on_frame = [&frames](const RecordingRow& row, const auto& shape) {
      frames.add(row, shape);
    };
  }
  std::vector<ReportSheet> sheets = report_sheets(*loaded);
  SessionObserver observer(loaded->scene, sheets, options.rate_Hz);
  if (!arguments.session_report.empty())
    options.on_tick = [&observer](const SeenTick& tick) { observer.see(tick); };
  Remesher remesher(loaded->sheets);
  loaded->sheets.clear();  // the remesher keeps its own copies
  std::optional<LinkReport> link;
  const Result<SessionReport> report = run(arguments, *loaded, remesher, options, link);
  if (!report) return fail(report.error());
  if (!arguments.quiet) {
    print_outcome(*report, options);
    if (!report->realtime.note.empty()) {
      std::fprintf(stderr, "trocar-run: note: %s\n", report->realtime.note.c_str());
    }
  }
  std::vector<Error> errors =
      write_outputs(arguments, *loaded, options, *report, remesher, link, frames);
  if (!arguments.session_report.empty()) {
    for (const Result<void>& done : write_session_report(arguments, *loaded, options, *report,
                                                         remesher, std::move(sheets), observer)) {
      if (!done) errors.push_back(done.error());
    }
  }
  return conclude(*report, std::move(errors), remesher);
}

int run_command_line(int argc, char** argv) {
  Arguments arguments;
  CLI::App app("Runs a session of the haptic loop over a scene.", kName);
  declare(app, arguments);
  if (const auto done = parse_command_line(app, argc, argv)) return *done;
  if (const Result<void> good = check_arguments(arguments); !good) return fail(good.error());
  stop_on_signals();
  struct sigaction action {};
  action.sa_handler = request_recovery;
  ::sigaction(SIGUSR1, &action, nullptr);
  return arguments.new_scene.empty() ? session(arguments) : make_scene(arguments);
}

}  // namespace
}  // namespace trocar::runtime

int main(int argc, char** argv) {
  using namespace trocar::runtime;
  return trocar::run_program(kName, [&] { return run_command_line(argc, argv); });
}
