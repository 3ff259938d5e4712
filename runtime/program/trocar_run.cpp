// SPDX-License-Identifier: Apache-2.0
// The program trocar-run: what its commands do. Their options are in run_options.h.
#include <unistd.h>
#include <atomic>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <thread>
#include <utility>

#include "formats/asset/asset.h"
#include "formats/base/command_line.h"
#include "formats/base/files.h"
#include "formats/base/json.h"
#include "formats/base/text.h"
#include "formats/session/procedures.h"
#include "runtime/check/device_trial.h"
#include "runtime/check/new_scene.h"
#include "runtime/check/scene_check.h"
#include "runtime/program/library_versions.h"
#include "runtime/program/session_inputs.h"
#include "runtime/program/session_outputs.h"
#include "runtime/realtime/realtime_thread.h"
#include "runtime/report/history.h"
#include "runtime/session/live_hand.h"
#include "runtime/session/open_device.h"
#include "runtime/session/origin.h"
#include "runtime/session/pose_session.h"
#include "runtime/session/session.h"
#include "runtime/session/session_options.h"

namespace trocar::runtime {
namespace {

constexpr int kStopping[] = {SIGTSTP, SIGTTIN, SIGTTOU};
constexpr int kEnding[] = {SIGQUIT, SIGXCPU,   SIGALRM, SIGUSR2, SIGVTALRM,
                           SIGPROF, SIGSTKFLT, SIGIO,   SIGPWR};
constexpr auto kPoll = std::chrono::milliseconds(2);
/// Periods in which zero force was written before the process may stop: a connection of another
/// maker sends a command one or two periods after it was written.
constexpr std::uint64_t kZeroPeriods = 4;
/// A loop that does not pause within this time does not run (any more).
constexpr auto kPatience = std::chrono::seconds(1);

Suspension the_suspension;
std::atomic<bool> recovery_requested{false};  ///< by SIGUSR1

void handle(int signal, void (*handler)(int)) {
  struct sigaction action {};
  action.sa_handler = handler;
  // Writing to a terminal that is not the process's own raises SIGTTOU: the write then fails.
  action.sa_flags = signal == SIGTTOU ? 0 : SA_RESTART;
  ::sigaction(signal, &action, nullptr);
}

/// Signals that stop or end a process at once by default, while a session runs. A device keeps its
/// last command for a while, so forces must be zero first.
///  - SIGTSTP (Ctrl-Z), SIGTTIN, SIGTTOU: the session is paused as by the operator. Once zero force
///    was written, the process stops. After SIGCONT the session is still paused: it goes on after a
///    resume or a request for recovery.
///  - SIGQUIT, SIGXCPU, SIGALRM and the like: the session ends as after Ctrl-C.
/// Only one object may exist at a time.
class SuspendingSignals {
 public:
  /// `loop_cpu`: the haptic thread's processor, which the object's thread keeps off; -1: any.
  explicit SuspendingSignals(int loop_cpu) : avoided_cpu_(loop_cpu) {
    for (const int signal : kStopping)
      handle(signal, [](int) { the_suspension.is_requested.store(true); });
    for (const int signal : kEnding)
      handle(signal, [](int) { stop_requested.store(true); });
    thread_.start(kPoll, [this] { serve(); });
  }
  /// Gives the signals that stop the process their default effect again.
  ~SuspendingSignals() {
    for (const int signal : kStopping)
      handle(signal, SIG_DFL);
    thread_.stop();
  }
  SuspendingSignals(const SuspendingSignals&) = delete;
  SuspendingSignals& operator=(const SuspendingSignals&) = delete;

 private:
  void serve() {
    keep_off(std::exchange(avoided_cpu_, -1));
    if (!the_suspension.is_requested.load()) return;
    const std::uint64_t wanted = the_suspension.paused_periods.load() + kZeroPeriods;
    const auto until = std::chrono::steady_clock::now() + kPatience;
    while (the_suspension.paused_periods.load() < wanted &&
           std::chrono::steady_clock::now() < until)
      std::this_thread::sleep_for(kPoll);
    ::kill(::getpid(), SIGSTOP);
    the_suspension.is_requested.store(false);  // the loop has latched the pause
    std::fprintf(
        stderr,
        "trocar-run: the session was stopped, and is paused: resume it on its page, or let "
        "forces return with kill -USR1 %d\n",
        static_cast<int>(::getpid()));
  }

  int avoided_cpu_;  ///< until the thread keeps off it; then -1
  PollingThread thread_;
};

/// Prints what a device of another maker has to say, also while the session runs.
void say_line(const std::string& line) {
  print(stderr, "trocar-run: %s\n", line);
}

/// Runs the session. `hand`: the scene's live hand, or null. `link` receives the report of the device's link, if there is one.
Result<SessionResult> run(const RunArguments& arguments, const SessionInputs& inputs,
                          Remesher& remesher, LiveHand* hand, SessionOptions& options,
                          std::optional<LinkReport>& link) {
  if (!inputs.replay.empty()) {
    const OpenedDevice replayed =
        inputs.pose_device
            ? make_pose_hand(*inputs.pose_device, inputs.scene,
                             std::make_unique<ReplayPoseDevice>(inputs.replay))
            : make_four_legs(inputs.description, std::make_unique<ReplayDevice>(inputs.replay));
    return run_session(
        inputs.scene, remesher, *replayed.device, [](double) {}, options);
  }
  const AnyDeviceDescription description = inputs.device();
  Result<OpenedDevice> opened =
      open_device(arguments.device, {.scene = inputs.scene,
                                     .scene_name = arguments.scene,
                                     .description = description,
                                     .key_file = arguments.key_file,
                                     .is_simulated = arguments.is_simulated,
                                     .clock = options.clock,
                                     .rate_Hz = options.rate_Hz,
                                     .hand = hand,
                                     .say = say_line});
  if (!opened) return opened.error();
  HandDevice& device = *opened->device;
  // A lock-step drive waits for the loop.
  if (device.is_paced_by_loop() && arguments.late_ticks_in_row.value_or(0) == 0)
    options.limits.gap_max_s = 0;
  // Workers are made before start(), because a drive behind a link ends a session in which
  // no tick comes.
  Result<SessionWorkers> workers =
      make_workers(inputs.scene, device.specification(), remesher, options);
  if (!workers) {  // a refusal is of the scene, another error is not
    const Error& why = workers.error();
    return why.code == ExitCode::kRefused ? why.after(arguments.scene + ": ") : why;
  }
  // A session of the simulated device that waits for nobody may stop and go on as it is.
  std::optional<SuspendingSignals> signals;
  if (options.is_real_time() || may_have_motors(arguments.device)) {
    signals.emplace(options.cpu);
    options.suspension = &the_suspension;
  }
  if (Result<void> started = device.start(); !started) return started.error();
  std::optional<Progress> progress;
  if (options.clock == Clock::kReal && !arguments.quiet && ::isatty(STDERR_FILENO) != 0)
    options.observers.push_back(&progress.emplace(options.duration_s));
  Result<SessionResult> report = run_session(
      inputs.scene, remesher, device, [&device](double dt_s) { device.advance(dt_s); }, options,
      std::move(*workers));
  progress.reset();
  options.observers.clear();
  device.close();
  signals.reset();
  link = device.link_report();
  if (link && link->restore_error)
    print(stderr, "trocar-run: the link was not restored: %s\n", link->restore_error->message);
  return report;
}

/// Checks that a person can hold the scene's hand, if it is live. Errors: (usage) the options do not allow that.
Result<void> check_hand_options(const RunArguments& arguments, const Scene& scene) {
  const bool is_live = scene.hand.live && arguments.replay.empty();
  if (!is_live && !arguments.hand_path.empty())
    return usage("--hand-path: is for a session whose hand is live");
  if (!is_live || arguments.is_check) return {};
  const std::string live_hand = arguments.scene + ": its hand is live";
  if (arguments.device != kDefaultDevice)
    return usage("--device " + arguments.device + ": " + live_hand +
                 ", which is for the simulated device " + std::string(kDefaultDevice));
  if (arguments.session.clock != Clock::kReal)
    return usage("--clock virtual: " + live_hand + ", which needs the real clock");
  if (arguments.live.empty())
    return usage(live_hand +
                 ", and without --live FILE nobody could move it; start it with trocar-console");
  return {};
}

/// Makes the scene's hand, if it is live. `device` must outlive it.
Result<std::unique_ptr<LiveHand>> make_live_hand(const RunArguments& arguments,
                                                 const SessionInputs& inputs,
                                                 const DeviceSpecification& device,
                                                 const SessionOptions& options) {
  if (!inputs.scene.hand.live || !options.replay.empty()) return std::unique_ptr<LiveHand>();
  const Result<LiveHandLimits> limits = live_hand_limits(inputs.scene, device, options.limits);
  if (!limits) return limits.error().after(arguments.scene + ": ");
  return std::make_unique<LiveHand>(
      *limits, make_tool(inputs.scene.tool), device, options.limits,
      TargetPath(arguments.hand_path.empty() ? 0 : options.duration_s));
}

/// Warns if the recording is shorter than its session.
void warn_of_short(const RunArguments& arguments, const SessionInputs& inputs,
                   std::uint64_t session_ticks) {
  if (arguments.quiet) return;
  const std::string& file = arguments.replay;
  if (inputs.replay_is_cut)
    print(stderr,
          "trocar-run: warning: %s: its last row is cut off, and is left out: the session "
          "was killed, or a part is missing\n",
          file);
  if (inputs.replay.size() >= session_ticks) return;
  print(stderr,
        "trocar-run: warning: %s: has %zu ticks, and its session was to last %llu: it ended early, "
        "or a part is missing\n",
        file, inputs.replay.size(), static_cast<unsigned long long>(session_ticks));
}

/// "about 7 minutes", or "less than a minute".
std::string words_of_time(double time_s) {
  const int minutes = static_cast<int>(time_s / 60);
  return minutes < 1 ? "less than a minute"
                     : "about " + std::to_string(minutes) + (minutes == 1 ? " minute" : " minutes");
}

/// Warns if the session may last so long that its recording cannot be read.
void warn_of_long(const RunArguments& arguments, const SessionOptions& options) {
  constexpr double kRowBytes = 1200;  // more than most rows have
  constexpr double kMaxTicks = static_cast<double>(kMaxRecordingBytes) / kRowBytes;
  if (arguments.quiet || !options.record || !(options.duration_s * options.rate_Hz > kMaxTicks))
    return;
  print(stderr,
        "trocar-run: warning: %s: may become larger than 4 GiB, and can then neither be "
        "replayed nor exported; at this rate record at most %.0f minutes\n",
        *options.record, std::floor(kMaxTicks / options.rate_Hz / 60));
}

/// The folder of the recording, or else the current folder, or else the one for temporary files.
std::filesystem::path default_black_box(const RunArguments& arguments) {
  if (arguments.session.record) {
    const std::filesystem::path folder = arguments.session.record->parent_path();
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

/// Returns the session's options, without outputs. Errors: (refused) the recording to replay
/// has no rate.
Result<SessionOptions> options_for(const RunArguments& arguments, const SessionInputs& inputs) {
  SessionOptions options = session_options(arguments);
  options.rate_Hz = arguments.rate_Hz.value_or(inputs.scene.rate_Hz.value_or(kDefaultRate_Hz));
  options.duration_s = arguments.duration_s.value_or(inputs.scene.duration_s);
  if (!inputs.replay.empty()) {
    const Result<double> rate_Hz =
        recorded_rate_Hz(inputs.replay, arguments.replay, stated_rate_Hz(inputs.replay_origin));
    if (!rate_Hz) return rate_Hz.error();
    options.rate_Hz = *rate_Hz;
    options.duration_s = stated_duration_s(inputs.replay_origin, inputs.scene);
    warn_of_short(arguments, inputs, tick_count(options.duration_s, *rate_Hz));
    options.replay = inputs.replay;
    set_stated_limits(inputs.replay_origin, options);
    options.counts_xray = recording_kind(inputs.replay_origin).has_xray;
  } else {
    warn_of_long(arguments, options);
  }
  options.on_low_space = [&arguments](double left_s) {
    if (arguments.quiet) return;
    print(stderr, "trocar-run: warning: %s: the disk has space for %s of recording\n",
          *arguments.session.record, words_of_time(left_s));
  };
  options.on_message = [&arguments](const OperatorMessage& message) {
    print_message(arguments, message);
  };
  options.stop = &stop_requested;
  options.recover = &recovery_requested;
  if (!options.black_box && !arguments.is_check && arguments.replay.empty())
    options.black_box = default_black_box(arguments);
  if (inputs.pose_device) {
    if (const auto stated = read_pose_device_origin(inputs.replay_origin))
      options.stiffness.margin = stated->stiffness_margin;
    set_pose_device_options(*inputs.pose_device, inputs.scene, options);
  }
  return options;
}

/// Writes the inputs into the origin of the recording. Errors: (refused) the recording to replay
/// has other inputs.
Result<void> set_origin(const RunArguments& arguments, const SessionInputs& inputs,
                        SessionOptions& options) {
  Result<RecordingOrigin> origin =
      make_origin(arguments.scene, inputs.scene, inputs.description, options);
  if (!origin) return origin.error();
  options.origin = std::move(*origin);
  if (!arguments.procedure.empty())
    options.origin.entries.emplace_back("procedure",
                                        arguments.procedure + "/" + to_string(arguments.strength));
  if (inputs.pose_device)
    write_pose_device_origin(inputs.pose_device_origin, *inputs.pose_device, inputs.scene, options,
                             options.origin);
  else if (arguments.force_scale)
    options.origin.entries.emplace_back("force-scale", origin_number(*arguments.force_scale));
  const std::optional<double> delay_s =
      inputs.pose_device ? inputs.pose_device->delay_s : inputs.description.delay_s;
  if (delay_s && *delay_s > 0)
    options.origin.entries.emplace_back(kOriginDelay, origin_number(*delay_s));
  // The session takes it from there.
  if (const std::string* const estimator = inputs.replay_origin.find(kOriginEstimator))
    options.origin.entries.emplace_back(kOriginEstimator, *estimator);
  const Result<Trainee> trainee = inputs.replay.empty() ? Result<Trainee>(arguments.trainee)
                                                        : stated_trainee(inputs.replay_origin);
  if (!trainee) return refused(arguments.replay + ": " + trainee.error().message);
  state_trainee(*trainee, options.origin);
  if (inputs.replay.empty()) return {};
  const Result<std::string> warning =
      check_replay(inputs.replay_origin, options.origin, arguments.replay);
  if (!warning) return warning.error();
  if (!warning->empty()) print(stderr, "trocar-run: warning: %s\n", warning->c_str());
  return {};
}

TelemetryOptions telemetry_options(const RunArguments& arguments, const SessionInputs& inputs) {
  TelemetryOptions telemetry{arguments.live,
                             arguments.scene,
                             inputs.replay.empty() ? arguments.device : "replay",
                             to_string(arguments.session.recovery),
                             {}};
  for (const SliceTissue& slice : inputs.tissues)
    telemetry.tissue_of_sheet.push_back(slice.choice.name);
  return telemetry;
}

/// Default of test --duration.
constexpr double kTrial_s = 5;
/// Height of the tip at which a scene for a pose device is proposed.
constexpr double kProposedMiddle_m = 0.15;

/// Returns the device for checks of a scene. The arguments must outlive the result.
DeviceToCheck to_check(const DeviceSpecification& specification,
                       const AnyDeviceDescription& description) {
  return {specification,
          [&description](const Scene& scene) { return simulate_device(scene, description); }};
}

/// Returns the document of formats/session/device_test.schema.json.
std::string summarize(const DeviceVerdict& verdict, const std::string& sentence,
                      const std::string& device) {
  const nlohmann::json summary = {{"schema", "trocar.device-test/1"},
                                  {"program", "trocar-run " TROCAR_VERSION},
                                  {"device", device},
                                  {"holds", verdict.troubles.empty()},
                                  {"verdict", sentence},
                                  {"troubles", verdict.troubles},
                                  {"numbers", verdict.text}};
  return json_text(summary, 2) + "\n";
}

int check_inputs(const RunArguments& arguments, const SessionInputs& inputs,
                 const DeviceSpecification& device, const SessionOptions& options) {
  const AnyDeviceDescription description = inputs.device();
  const Result<SceneCheck> checked =
      check_scene(inputs.scene, to_check(device, description), inputs.sheets, inputs.tissues,
                  inputs.bytes, options);
  if (!checked) return fail(checked.error().after(arguments.scene + ": "));
  if (!arguments.quiet) print_lines(stdout, checked->text);
  for (const std::string& warning : checked->warnings)
    warn(arguments, warning);
  if (!arguments.is_strict || checked->warnings.empty()) return 0;
  return fail(refused(arguments.scene + ": " + std::to_string(checked->warnings.size()) +
                      (checked->warnings.size() == 1 ? " warning" : " warnings") +
                      ", and --strict allows none"));
}

/// Runs or replays a session, or checks a scene, as the arguments say.
int run_scene(const RunArguments& arguments) {
  Result<SessionInputs> inputs = load_inputs(arguments);
  if (!inputs) return fail(inputs.error());
  if (const auto good = check_run_outputs(arguments, *inputs); !good) return fail(good.error());
  if (const auto good = check_hand_options(arguments, inputs->scene); !good)
    return fail(good.error());
  Result<SessionOptions> options = options_for(arguments, *inputs);
  if (!options) return fail(options.error());
  const auto specification = make_specification(inputs->device(), inputs->scene);
  const DeviceSpecification& device = *specification;
  if (arguments.is_check) return check_inputs(arguments, *inputs, device, *options);
  const std::optional<std::string> unfitting = warn_of_unfitting(inputs->scene, inputs->tissues);
  if (unfitting && !arguments.quiet) warn(arguments, *unfitting);
  if (const auto done = set_origin(arguments, *inputs, *options); !done) return fail(done.error());
  if (!arguments.live.empty()) options->telemetry = telemetry_options(arguments, *inputs);

  const Result<std::unique_ptr<LiveHand>> hand =
      make_live_hand(arguments, *inputs, device, *options);
  if (!hand) return fail(hand.error());
  options->hand = hand->get();
  if (*hand && options->telemetry)
    options->telemetry->hand = PublishedHand{(*hand)->limits(), hand_impedance(inputs->scene.hand)};

  SessionOutputs outputs(arguments, *inputs, options->rate_Hz);
  outputs.collect(*options);
  Remesher remesher(inputs->sheets);
  inputs->sheets.clear();  // the remesher keeps its own copies
  std::optional<LinkReport> link;
  const Result<SessionResult> report =
      run(arguments, *inputs, remesher, hand->get(), *options, link);
  if (!report) return fail(report.error());
  if (!arguments.quiet) {
    print_outcome(*report, *options);
    if (!report->realtime.note.empty())
      print(stderr, "trocar-run: note: %s\n", report->realtime.note);
  }
  return conclude(*report, outputs.write(*options, *report, remesher, hand->get(), link), remesher);
}

/// Prints the values of one procedure, or of all, with the ranges and sources of the values.
int explain_procedures(const RunArguments& arguments) {
  const char* between = "";
  for (const Procedure& procedure : procedures()) {
    if (!arguments.procedure.empty() && arguments.procedure != procedure.name) continue;
    std::printf("%s%s", between, explain(procedure).c_str());
    between = "\n";
  }
  return 0;
}

/// Reads the session reports in a folder and its subfolders, and writes the history of the sessions
/// as a page and a table. In a folder without a session report, summaries are read instead.
int write_history(const RunArguments& arguments) {
  const std::filesystem::path page = arguments.output,
                              table = std::filesystem::path(page).replace_extension(".history.csv");
  const OutputFile outputs[] = {{"-o", page}, {"-o (its table)", table}};
  if (const Result<void> good = check_outputs(outputs, {}); !good) return fail(good.error());
  const Result<History> history = read_history(arguments.input);
  if (!history) return fail(history.error());
  for (const std::string& line : history->skipped)
    print(stderr, "trocar-run: skipped: %s\n", line);
  if (history->sessions == 0)
    return fail(refused(arguments.input + ": has no figures of a session; trocar-run "
                                          "--session-report writes them"));
  if (!arguments.quiet) print_lines(stdout, history_text(*history));
  for (const auto& [file, text] :
       {std::pair{page, history_page(*history)}, std::pair{table, history_csv(*history)}}) {
    if (const auto written = write_file_atomically(file, text, Readers::kOwner); !written)
      return fail(written.error());
  }
  return 0;
}

/// Tries the device without force, and prints whether a session would run undisturbed. If not, the
/// exit code is 5 (kDeviceFault), also after SIGINT, when there is no verdict and no summary.
int test_device(const RunArguments& arguments) {
  if (!may_have_motors(arguments.device))
    return fail(usage("test: is for a device process; " + arguments.device +
                      " has nothing to test; give --device"));
  const OutputFile outputs[] = {{"--summary", arguments.summary}};
  const std::filesystem::path inputs[] = {arguments.key_file, arguments.description};
  if (const Result<void> good = check_outputs(outputs, inputs); !good) return fail(good.error());
  Result<AnyDeviceDescription> description =
      read_description(arguments.description, arguments.device, HandleOrientation::kAsked);
  if (!description) return fail(description.error());
  assume_delay(arguments.device, arguments.rate_Hz.value_or(kDefaultRate_Hz), *description);
  SessionOptions options = session_options(arguments);
  options.duration_s = arguments.duration_s.value_or(kTrial_s);
  options.stop = &stop_requested;
  const Scene no_scene;
  const Result<OpenedDevice> opened =
      open_device(arguments.device, {.scene = no_scene,
                                     .scene_name = "test",
                                     .description = *description,
                                     .key_file = arguments.key_file,
                                     .is_simulated = arguments.is_simulated,
                                     .rate_Hz = options.rate_Hz,
                                     .say = say_line});
  if (!opened) return fail(opened.error());
  std::printf(
      "The device gets no force for %.3g s. Hold the tool if the device does not carry itself.\n",
      options.duration_s);
  if (arguments.push_N > 0)
    std::printf("Then it is pushed with %.3g N, to and fro by some millimetres: let go of it.\n",
                arguments.push_N);
  std::fflush(stdout);
  const Result<DeviceTrial> trial = try_device(*opened->device, options, arguments.push_N);
  if (!trial) return fail(trial.error());
  const DeviceVerdict verdict = describe(*trial, options, opened->device->specification());
  const std::string sentence = verdict.troubles.empty()
                                   ? "A session at this rate should hold."
                                   : "A session at this rate will not hold well.";
  print_lines(stdout, verdict.text);
  for (const std::string& trouble : verdict.troubles)
    print(stdout, "trouble: %s\n", trouble);
  print(stdout, "%s\n", sentence);
  if (!arguments.summary.empty()) {
    const auto written =
        write_file_atomically(arguments.summary, summarize(verdict, sentence, arguments.device));
    if (!written) return fail(written.error());
  }
  return verdict.troubles.empty() ? 0 : static_cast<int>(ExitCode::kDeviceFault);
}

/// Proposes a scene for an asset and writes it to a file.
int make_new_scene(const RunArguments& arguments) {
  const OutputFile outputs[] = {{"-o", arguments.output}};
  const std::filesystem::path inputs[] = {arguments.input, arguments.description};
  if (const Result<void> good = check_outputs(outputs, inputs); !good) return fail(good.error());
  Result<AnyDeviceDescription> description =
      read_description(arguments.description, arguments.device, HandleOrientation::kAssumed);
  if (!description) return fail(description.error());
  assume_delay(arguments.device, arguments.rate_Hz.value_or(kDefaultRate_Hz), *description);
  Result<Asset> asset = read_asset(arguments.input);
  if (!asset) return fail(asset.error());
  if (const auto ok = weld_materials(*asset, arguments.input); !ok) return fail(ok.error());
  SessionOptions options = session_options(arguments);
  options.clock = Clock::kVirtual;
  options.stop = &stop_requested;
  // A pose device lies around the middle of the scene's path, which is proposed around this place.
  Scene middle;
  middle.hand.trajectory = {{0, {0, 0, kProposedMiddle_m}, {}}};
  const auto specification = make_specification(*description, middle);
  DeviceToCheck device = to_check(*specification, *description);
  if (const auto* pose_device = std::get_if<PoseDeviceDescription>(&*description)) {
    device.set_options = [pose_device, initial = options](const Scene& scene, SessionOptions& set) {
      set.coupling = initial.coupling;
      set_pose_device_options(*pose_device, scene, set);
    };
    device.set_options(middle, options);
    options.coupling.on = arguments.session.coupling.on;
  }
  NewSceneChoices choices{arguments.has_live_hand, {}};
  if (arguments.entry_mm) choices.points = ChosenPoints{*arguments.entry_mm, arguments.target_mm};
  const Result<NewScene> made =
      propose_scene(*asset, arguments.input, arguments.output, device, options, choices);
  if (!made) return fail(made.error());
  if (const auto written = write_file_atomically(arguments.output, made->json); !written)
    return fail(written.error());
  if (!arguments.quiet) print_lines(stdout, made->text);
  return 0;
}

/// trocar-run without a command runs a session.
struct RunCommandLine {
  CLI::App app{
      "Lets a hand feel the force of tissue on a needle or another tool: a haptic device, a\n"
      "machine with motors, pushes the hand with this force. A session is a run of the haptic\n"
      "loop, which reads the device and computes the force in every tick, by default 1000 times\n"
      "a second.",
      kProgram};
  RunArguments arguments;
  CLI::App *check, *new_scene, *test, *history, *procedures;

  RunCommandLine() {
    add_help(app, "trocar-run " TROCAR_VERSION " (" + library_versions() +
                      ", Draco and tinygltf for assets)");
    declare_run(app, arguments);
    const auto add = [this](const char* name, const char* help, auto declare, auto& values) {
      CLI::App* const command = app.add_subcommand(name, help);
      declare(*command, values);
      return command;
    };
    check = add("check", "check a scene: path, forces and region, then a dry run with warnings",
                declare_check, arguments);
    new_scene = add("new-scene", "propose a scene for an asset", declare_new_scene, arguments);
    add("replay", "compute a recorded session again from its inputs, and compare the torques",
        declare_replay, arguments);
    test = add("test", "read a device without force: would a session run without faults?",
               declare_test, arguments);
    history = add("history", "write the learning curves of a folder of sessions", declare_history,
                  arguments);
    procedures = add("procedures", "print the values of --procedure with their sources",
                     declare_procedures, arguments);
    // A command takes the footer that is set when it is added. This one is for the program alone.
    app.footer(
        "trocar-run COMMAND --help describes a command and its options.\n"
        "Exit codes: 0 done; 2 wrong usage; 3 input refused, or torques of a replay differ, or a\n"
        "warning of check --strict; 4 output not written; 5 device failed, or a fault ended the\n"
        "session, or test found trouble, or a check was interrupted before its result; 1 an\n"
        "internal error. Ctrl-C ends a session with zero torques and complete files.");
  }

  int run() {
    const CLI::App* const command = given_command(app);
    if (command == procedures) return explain_procedures(arguments);
    if (command == history) return write_history(arguments);
    if (command == nullptr) {
      if (arguments.scene.empty()) return fail(usage("SCENE is required (see trocar-run --help)"));
      if (const auto good = check_command(app, arguments.scene); !good) return fail(good.error());
    }
    arguments.is_check = command == check;
    if (const auto good = check_options(arguments); !good) return fail(good.error());
    stop_on_signals();
    struct sigaction action {};
    action.sa_handler = [](int) { recovery_requested.store(true); };
    ::sigaction(SIGUSR1, &action, nullptr);
    if (command == test) return test_device(arguments);
    return command == new_scene ? make_new_scene(arguments) : run_scene(arguments);
  }
};

}  // namespace
}  // namespace trocar::runtime

int main(int argc, char** argv) {
  using namespace trocar::runtime;
  return trocar::run_program(kProgram, [&] {
    RunCommandLine line;
    const auto done = trocar::parse_or_end(line.app, {argv, argv + argc});
    return done ? *done : line.run();
  });
}
