// SPDX-License-Identifier: Apache-2.0
#include "runtime/program/run_options.h"

#include "formats/base/command_line.h"

namespace trocar::runtime {
namespace {

using Recoveries = std::vector<std::pair<std::string, RecoveryPolicy>>;

const Recoveries& recoveries() {
  static const Recoveries words{{"never", RecoveryPolicy::kNever},
                                {"auto", RecoveryPolicy::kAuto},
                                {"signal", RecoveryPolicy::kOnRequest}};
  return words;
}

std::vector<std::string> all_procedures() {
  std::vector<std::string> names;
  for (const Procedure& each : procedures())
    names.emplace_back(each.name);
  return names;
}

std::string why_no_page(const std::string& name) {
  const std::filesystem::path file = name;
  return file.extension() == ".html" && !file.stem().empty() ? ""
                                                             : "must be a name that ends in .html";
}

/// Declares an option for a point X,Y,Z in mm.
CLI::Option* add_point(CLI::App& app, const char* name, std::optional<std::array<double, 3>>& point,
                       const char* help) {
  const auto read = [&point](const std::string& text) {
    constexpr double kMost_mm = 1e4;
    const auto n = numbers<double>(text, "#,#,#");
    const bool is_near =
        n && std::all_of(n->begin(), n->end(), [](double mm) { return std::abs(mm) <= kMost_mm; });
    if (is_near) point = {(*n)[0], (*n)[1], (*n)[2]};
    return is_near ? "" : "must be three numbers X,Y,Z: mm in the patient's frame, DICOM's LPS";
  };
  return add_parsed(app, name, read, help, "X,Y,Z");
}

void add_scene(CLI::App& app, RunArguments& a) {
  CLI::Option* const scene =
      app.add_option("SCENE", a.scene, "the scene (JSON: formats/session/scene.schema.json)");
  scene->required(app.get_parent() != nullptr);
  app.add_option("--asset", a.asset,
                 "use this asset (.glb, from trocar-mesh) instead of the scene's")
      ->type_name("FILE");
  const auto set_law = [&a](const std::string& word) {
    a.force_law = force_law_from_string(word);
    return a.force_law ? "" : "must be " + force_law_names();
  };
  add_parsed(app, "--force-law", set_law,
             force_law_names() +
                 ": rule by which the tissue's\n"
                 "force is computed, instead of the scene's. hooke: one spring for each slice; "
                 "network: a\n"
                 "spring network for each slice; cutting: bone as one solid that the tool cuts",
             "LAW");
  CLI::Option* const procedure =
      app.add_option("--procedure", a.procedure,
                     "tool, soft layers and bone of this procedure instead of the scene's");
  one_of(procedure, all_procedures());
  add_choice<Strength>(
      app, "--strength", a.strength,
      {{"low", Strength::kLow}, {"median", Strength::kMedian}, {"high", Strength::kHigh}},
      "with --procedure: 5th percentile of each quantity, median or 95th (default: median)")
      ->needs(procedure);
  set_heading(app, "Scene");
}

/// What states a device without connecting to it.
void add_description(CLI::App& app, RunArguments& a) {
  app.add_option("--device-description", a.description,
                 "geometry and limits of the device (JSON), instead of the scene's")
      ->type_name("FILE");
  add_number(app, "--force-limit", a.force_limit_N, {0.01, 1000, "N", "N"},
             "largest force that is sent to a device that measures its own pose, 0.01 "
             "to 1000 N (default:\n"
             "that of its description)");
  add_number(app, "--force-scale", a.force_scale, {1e-3, 10, "FACTOR"},
             "factor on the forces of the tissue, 0.001 to 10 (default: the scene's; for a device\n"
             "that measures its own pose, lowered until it can produce the largest force of each\n"
             "slice and soft layer; of slices 1.5 times that with the force law cutting, because\n"
             "friction on the shaft adds to it)");
  set_heading(app, "Device");
}

void add_device(CLI::App& app, RunArguments& a) {
  app.add_option("--device", a.device,
                 device_uri_help() +
                     "\nudp is for the four-legged device. inproc simulates that device, or the "
                     "one of\n--device-description (default: " +
                     std::string(kDefaultDevice) + ")")
      ->type_name("DEVICE");
  app.add_flag(
      "--simulated", a.is_simulated,
      "with udp and pose: the device has no motors, it is only simulated. Late ticks are then\n"
      "no fault, and data may be missing for 250 ms instead of 10 ms (neither holds with\n"
      "--late-ticks-in-row above 0). Without --simulated, the limits of stiffness that follow\n"
      "from the device's description are halved, as a margin; --stiffness-limit never is");
  app.add_option("--key-file", a.key_file,
                 "secret key, by which this program and the device process recognise each other")
      ->type_name("FILE");
  add_description(app, a);
  set_heading(app, "Device");
}

/// The settings of the haptic loop that a check and a replay have, too.
void add_loop(CLI::App& app, RunArguments& a) {
  SessionOptions& session = a.session;
  add_choice<CompensationOptions>(
      app, "--compensate", session.compensation,
      {{"none", {}},
       {"friction", CompensationOptions{.friction = true}},
       {"weight", CompensationOptions{.gravity = true}},
       {"both", CompensationOptions{.friction = true, .gravity = true}}},
      "which of the device's own forces the motors cancel (default: none)");
  set_heading(app, "Device");
  add_number(app, "--energy-limit", session.limits.energy_limit_J, {1e-3, 10, "J", "J"},
             "largest energy that the device may give to the hand within 0.1 s, beyond\n"
             "what tissue and coupling held before, J; else the fault energy_limit");
  add_number(app, "--stiffness-limit", session.stiffness.max_N_per_m, {10, 1e8, "N/M", "N/m"},
             "largest stiffness of contact at the tool's tip, 10 to 100000000 N/m; for a device\n"
             "that measures its own pose with every force law, for the four-legged one with\n"
             "cutting. The lowest of all limits counts")
      ->default_str("");
  set_heading(app, "Safety");
  add_choice<bool>(app, "--passivity", session.guards, {{"on", true}, {"off", false}},
                   "off: no guard against oscillation, no damping after a break (default: on)")
      ->group(kDiagnostics);
  const auto set_coupling = [&coupling = session.coupling](double stiffness_N_per_m) {
    const CouplingOptions usual;
    coupling.on = true;
    coupling.stiffness_N_per_m = stiffness_N_per_m;
    // The damping is in proportion, or a soft coupling would be stiff within a tick.
    coupling.damping_N_s_per_m =
        stiffness_N_per_m / usual.stiffness_N_per_m * usual.damping_N_s_per_m;
  };
  within(app.add_option_function<double>(
             "--coupling", set_coupling,
             "spring of 100 to 1000000 N/m between the device and a virtual tool (proxy), which "
             "alone\n"
             "touches the tissue. Default with hooke and network: none, but for a device that\n"
             "measures its own pose one is chosen; with cutting: by scene and device"),
         {100, 1e6, "N/M", "N/m"})
      ->group(kDiagnostics);
}

void add_rate(CLI::App& app, RunArguments& a) {
  add_number(app, "--rate", a.rate_Hz, {kMinRate_Hz, kMaxRate_Hz, "HZ", "Hz"},
             "rate of the haptic loop, 100 to 8000 Hz (default: the scene's, or 1000)");
  set_heading(app, "Session");
}

void add_duration(CLI::App& app, RunArguments& a, const char* help) {
  add_number(app, "--duration", a.duration_s, {1e-3, kMaxDuration_s, "S", "s"}, help);
  set_heading(app, "Session");
}

void add_quiet(CLI::App& app, RunArguments& a) {
  app.add_flag("--quiet", a.quiet, "print errors only");
  set_heading(app, "Session");
}

/// What a session has and a replay has not.
void add_realtime(CLI::App& app, RunArguments& a) {
  add_number(app, "--late-ticks-in-row", a.late_ticks_in_row, {0, 1e9, "N"},
             "late ticks in a row that are a fault; 0: none (default: 3 for a device "
             "with motors, else 0)");
  const long processors = ::sysconf(_SC_NPROCESSORS_CONF);
  add_number(app, "--cpu", a.session.cpu,
             {0, processors > 0 ? static_cast<double>(processors - 1) : 1e6, "N",
              "(the processors of this machine)"},
             "number of the processor on which the haptic loop stays (default: any)")
      ->default_str("")
      ->group(kDiagnostics);
  set_heading(app, "Safety");
}

/// A file that the program writes.
CLI::Option* add_file(CLI::App& app, const char* name, std::string& file, const char* help) {
  return app.add_option(name, file, help)->type_name("FILE");
}

void add_outputs(CLI::App& app, RunArguments& a) {
  app.add_option("--record", a.session.record,
                 "write a recording: CSV, one row per tick; NAME.partial until it is complete")
      ->type_name("FILE");
  add_file(app, "--summary", a.summary, "write a summary of the session as JSON");
  checked_by(
      add_file(app, "--session-report", a.session_report,
               "write a report for the debriefing: NAME.html, NAME.json and NAME.figures.csv"),
      why_no_page)
      ->type_name("NAME.html");
  add_file(app, "--meshes", a.meshes,
           "write the sheets (the slices' meshes) before and after the punctures, as JSON")
      ->group(kDiagnostics);
  add_file(app, "--frames", a.frames,
           "write the sheet around the tool 30 times a second, as lines of JSON")
      ->group(kDiagnostics);
  set_heading(app, "Recording");
  add_choice<RecoveryPolicy>(app, "--recover", a.session.recovery, recoveries(),
                             "after a fault or a stop, never: end; signal: forces rise again on "
                             "SIGUSR1; auto, only without\n"
                             "motors: after a fault by themselves (default: never)");
  app.add_option("--black-box", a.session.black_box,
                 "folder for the last 4 s before a fault (default: that of --record, the current "
                 "folder or the\n"
                 "one for temporary files; a replay: none)")
      ->type_name("FOLDER");
  set_heading(app, "Safety");
  app.add_option(
         "--live", a.live,
         "let other programs show and command the session through FILE, such as trocar-console\n"
         "--attach FILE")
      ->type_name("FILE");
  set_heading(app, "Session");
}

void add_trainee(CLI::App& app, Trainee& trainee) {
  checked_by(app.add_option("--trainee", trainee.code,
                            "code of the trainee: 1 to 32 letters, digits, - or _"),
             trainee_code_error)
      ->type_name("CODE");
  checked_by(app.add_option("--course", trainee.course,
                            "name of the course: 1 to 32 letters, digits, - or _"),
             trainee_code_error)
      ->type_name("NAME");
  add_number(app, "--attempt", trainee.attempt, {1, static_cast<double>(kMaxAttempt), "N"},
             "number of the attempt, 1 to 9999");
  set_heading(app, "Recording");
}

Result<void> check_simulated(const RunArguments& a) {
  if (!a.is_simulated || is_device_process(a.device)) return {};
  if (!may_have_motors(a.device))
    return usage("--simulated: is for a device process; " + a.device + " is always simulated");
  return usage("--simulated: is for a device process; " + a.device +
               " has motors. For a program that stands in for it, allow late ticks by "
               "--late-ticks-in-row 0");
}

/// Returns the longest time without a new device state that a session with these arguments allows.
double no_data_max_s(const RunArguments& a) {
  const bool may_stall =
      a.is_simulated && a.late_ticks_in_row.value_or(0) == 0 && a.session.clock == Clock::kReal;
  return may_stall ? kSimulatedNoData_s : SafetyLimits{}.no_data_max_s;
}

}  // namespace

const char* to_string(RecoveryPolicy recovery) {
  for (const auto& [word, value] : recoveries())
    if (value == recovery) return word.c_str();
  return "";
}

void declare_run(CLI::App& app, RunArguments& a) {
  add_scene(app, a);
  add_device(app, a);
  add_choice<Clock>(
      app, "--clock", a.session.clock, {{"real", Clock::kReal}, {"virtual", Clock::kVirtual}},
      "real: ticks follow the wall clock; virtual: without a pause, the same result in every run\n"
      "(default: real)");
  set_heading(app, "Session");
  add_rate(app, a);
  add_duration(app, a, "duration in s (default: the scene's)");
  add_outputs(app, a);
  app.add_flag(
         "--xray", a.session.counts_xray,
         "with --live: other programs may ask for simulated X-ray pictures, which are counted")
      ->needs("--live");
  set_heading(app, "Session");
  add_trainee(app, a.trainee);
  add_file(app, "--hand-path", a.hand_path,
           "write the motion of a live hand as JSON, for use as the `hand` of a scene");
  set_heading(app, "Recording");
  add_loop(app, a);
  add_realtime(app, a);
  add_quiet(app, a);
}

void declare_check(CLI::App& app, RunArguments& a) {
  add_scene(app, a);
  app.add_flag("--strict", a.is_strict, "end with exit code 3 if there is a warning");
  add_device(app, a);
  add_rate(app, a);
  add_duration(app, a, "duration in s (default: the scene's)");
  add_loop(app, a);
  add_quiet(app, a);
}

void declare_replay(CLI::App& app, RunArguments& a) {
  add_scene(app, a);
  app.add_option("RECORDING", a.replay, "the recording of a session in this scene (CSV)")
      ->required();
  add_description(app, a);
  add_outputs(app, a);
  add_loop(app, a);
  add_quiet(app, a);
}

void declare_test(CLI::App& app, RunArguments& a) {
  add_device(app, a);
  add_rate(app, a);
  add_duration(app, a, "duration in s (default: 5)");
  add_number(app, "--push", a.push_N, {0.1, 5, "N", "N"},
             "then push the free device with this force, 0.1 to 5 N, to measure its delay, mass\n"
             "and friction (default: no force)")
      ->default_str("");
  set_heading(app, "Device");
  add_file(app, "--summary", a.summary, "write the result as JSON");
  set_heading(app, "Recording");
  add_realtime(app, a);
  add_quiet(app, a);
}

void declare_new_scene(CLI::App& app, RunArguments& a) {
  app.add_option("ASSET", a.input, "the asset (.glb) for which a scene is proposed")->required();
  app.add_option("-o,--output", a.output, "the scene to write (JSON)")
      ->type_name("FILE")
      ->required();
  CLI::Option* const entry = add_point(
      app, "--entry", a.entry_mm,
      "point X,Y,Z on the needle's path, at or outside the bone's surface, mm in DICOM's patient\n"
      "coordinates, LPS (default: where the bone is thickest)");
  add_point(app, "--target", a.target_mm,
            "point that the needle must reach (default: straight down)")
      ->needs(entry);
  app.add_flag("--live-hand", a.has_live_hand,
               "make a scene whose simulated hand you move in trocar-console");
  add_device(app, a);
  add_rate(app, a);
  add_loop(app, a);
  add_quiet(app, a);
}

void declare_history(CLI::App& app, RunArguments& a) {
  app.add_option("FOLDER", a.input,
                 "folder of session reports; where one has none, its summary is read")
      ->required();
  checked_by(app.add_option(
                 "-o,--output", a.output,
                 "the page to write, with the learning curves of each trainee, course and scene; "
                 "their\nnumbers are written to NAME.history.csv"),
             why_no_page)
      ->type_name("NAME.html")
      ->required();
  add_quiet(app, a);
}

void declare_procedures(CLI::App& app, RunArguments& a) {
  one_of(app.add_option("PROCEDURE", a.procedure, "print this one (default: all)"),
         all_procedures());
}

Result<void> check_options(const RunArguments& a) {
  const bool is_cutting = a.force_law.value_or(ForceLawKind::kCutting) == ForceLawKind::kCutting;
  if (!a.procedure.empty() && !is_cutting)
    return usage(std::string("--force-law ") + to_string(*a.force_law) +
                 ": a procedure is for the force law cutting");
  const Result<void> device = check_device_uri(a.device, !a.key_file.empty());
  if (!device) return device.error();
  if (const Result<void> good = check_simulated(a); !good) return good.error();
  if (a.session.recovery == RecoveryPolicy::kAuto && may_have_motors(a.device) &&
      !(a.is_simulated && is_device_process(a.device)))
    return usage("--recover auto: would let forces return by itself, and " + a.device +
                 " may have motors; use --recover signal" +
                 (is_device_process(a.device) ? ", or --simulated if it has none" : ""));
  return {};
}

SessionOptions session_options(const RunArguments& a) {
  SessionOptions options = a.session;
  const bool is_simulated = !may_have_motors(a.device) || a.is_simulated;
  options.rate_Hz = a.rate_Hz.value_or(kDefaultRate_Hz);
  options.stiffness.margin = is_simulated ? 1 : kHardwareMargin;
  const int late_ticks = a.late_ticks_in_row.value_or(is_simulated ? 0 : kDefaultLateTicks);
  options.limits.missed_deadlines_max =
      late_ticks > 0 ? late_ticks - 1 : std::numeric_limits<int>::max();
  // A simulated device process is not harmed by a gap or a stall either, but a leap of its clock
  // stays a fault. (The device in the process has none.)
  if (a.is_simulated && late_ticks == 0) options.limits.gap_max_s = 0;
  options.limits.no_data_max_s = no_data_max_s(a);
  return options;
}

}  // namespace trocar::runtime
