// SPDX-License-Identifier: Apache-2.0
#include "runtime/console/supervisor.h"

#include <algorithm>
#include <csignal>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "formats/base/json.h"
#include "formats/base/text.h"

namespace trocar::runtime {
namespace {

using nlohmann::json;

constexpr auto kZeroWithin = std::chrono::milliseconds(100);
constexpr auto kSearchEvery = std::chrono::milliseconds(100);
/// A longer time between two polls counts as this one, because then this console stood still, and
/// perhaps not the session.
constexpr auto kLongestPoll = std::chrono::milliseconds(20);
constexpr auto kDeviceWithin = std::chrono::seconds(10);
constexpr const char* kAnyPort = "127.0.0.1:0";
constexpr std::size_t kTorqueColumns = 8, kWrenchColumns = 6;

/// The body of /api/start that starts the same session again, without its trainee.
json request_json(const StartRequest& request, const std::filesystem::path& folder) {
  const auto name = [&folder](const std::filesystem::path& file) {
    return file.lexically_relative(folder).generic_string();
  };
  json out = {
      {"scene", name(request.scene)}, {"device", request.device.name}, {"clock", request.clock}};
  if (!request.asset.empty()) out["asset"] = name(request.asset);
  if (request.duration_s) out["duration_s"] = *request.duration_s;
  if (!request.force_law.empty()) out["force_law"] = request.force_law;
  return out;
}

}  // namespace

const char* to_string(RunState state) noexcept {
  constexpr std::array<const char*, 7> kNames = {"idle",   "starting", "running", "silent",
                                                 "paused", "ended",    "lost"};
  return kNames[static_cast<std::size_t>(state)];
}

Supervisor::Supervisor(Settings settings) : settings_(std::move(settings)) {
  for (const auto& [folder, shown] :
       {std::pair(settings_.folder, ""), std::pair(settings_.programs, ""),
        std::pair(settings_.sessions, "sessions/")}) {
    if (folder.has_relative_path()) hidden_.add((folder / "").string(), shown);
  }
  for (const DeviceChoice& device : settings_.devices)
    hidden_.add(device);
  // A page has no command line.
  hidden_.add("--asset names another", "choose another one in the field Asset");
  set_state(RunState::kIdle, "no session");
}

std::filesystem::path Supervisor::live_link() const {
  return is_ours() ? settings_.sessions / "live" : settings_.attach;
}

std::filesystem::path Supervisor::log_file() const {
  return session_folder_.empty() ? std::filesystem::path() : session_folder_ / "log.txt";
}

void Supervisor::set_state(RunState state, const std::string& said) {
  const std::string message = hidden_.hide(said);
  if (state == state_ && message == message_ && !state_json_.empty()) return;
  state_ = state;
  message_ = message;
  json out = {{"state", to_string(state)}, {"message", message}};
  if (state != RunState::kIdle) out["device"] = request_.device.name;
  // A session that was found has no request.
  if (!request_.scene.empty()) out["request"] = request_json(request_, settings_.folder);
  if (state == RunState::kEnded || state == RunState::kLost) {
    if (run_ && run_->exit_code()) out["exit_code"] = *run_->exit_code();
    if (is_emergency_stopped_) out["emergency_stop"] = true;
    std::error_code ignored;
    for (const auto& [key, name] :
         {std::pair("report", "session.html"), std::pair("recording", "session.csv"),
          std::pair("recording", "session.csv.partial")}) {
      if (!session_folder_.empty() && !out.contains(key) &&
          std::filesystem::exists(session_folder_ / name, ignored))
        out[key] = "sessions" / session_folder_.filename() / name;
    }
  }
  state_json_ = json_text(out);
  ++state_version_;
}

Result<void> Supervisor::check_free() {
  if (settings_.folder.empty()) return refused("this console plays recordings");
  if (!is_ours())
    return refused("this console only watches " + settings_.attach.filename().string());
  if (!is_live() && (!run_ || run_->has_ended())) {
    // Another console on the same folder may have started a session since the last search.
    searched_at_ = {};
    search_session(Clock::now());
  }
  if (is_live() || (run_ && !run_->has_ended()))
    return refused("a session runs already; stop it first");
  if (test_.is_running()) return refused("a device is being tested; wait for that, or stop it");
  if (scene_maker_.is_running()) return refused("a scene is being made; wait for that, or stop it");
  return {};
}

Result<void> Supervisor::make_scene(const NewSceneRequest& request) {
  if (auto free = check_free(); !free) return free;
  std::vector<std::string> options;
  if (settings_.stiffness_limit_N_per_m)
    options = {"--stiffness-limit", text_line("%.9g", *settings_.stiffness_limit_N_per_m)};
  return scene_maker_.start(request, {settings_.programs, settings_.folder, settings_.sessions},
                            options);
}

Result<void> Supervisor::test_device(const DeviceChoice& device) {
  if (auto free = check_free(); !free) return free;
  if (!device.can_be_tested())
    return refused(device.name +
                   " is a simulated device of the console's own: there is nothing to test");
  return test_.start(device, settings_.programs, settings_.sessions);
}

Result<void> Supervisor::start(const StartRequest& request) {
  if (auto free = check_free(); !free) return free;
  auto folder = create_session_folder(settings_.sessions, request.scene);
  if (!folder) return folder.error();
  session_folder_ = std::move(*folder);
  request_ = request;
  scene_file_ = request.scene;
  asset_file_ = request.asset;
  run_.reset();
  release_device(SIGTERM);
  telemetry_.clear();
  device_endpoint_.clear();
  started_at_ = Clock::now();
  is_start_stopped_ = is_emergency_stopped_ = false;
  is_started_here_ = true;
  waits_for_device_ = request_.device.name == kSimulator;
  Result<void> started = note_device();  // a full disk is found before a program starts
  if (started) started = waits_for_device_ ? start_device(kAnyPort) : start_run();
  if (!started) {
    waits_for_device_ = false;
    set_state(RunState::kIdle, started.error().message);
    return started;
  }
  set_state(RunState::kStarting, "starting " + request.scene.filename().string());
  return {};
}

Result<void> Supervisor::start_device(const std::string& endpoint) {
  std::error_code ignored;
  const auto log = log_file();
  device_log_from_ = std::filesystem::exists(log, ignored) ? std::filesystem::file_size(log) : 0;
  std::vector<std::string> words = {settings_.programs / "trocar-device-sim",
                                    scene_file_.string(),
                                    "--listen",
                                    endpoint,
                                    "--key-file",
                                    session_folder_ / "key",
                                    "--watchdog",
                                    "0.25"};
  if (request_.clock == "virtual") words.insert(words.end(), {"--clock", "lock-step"});
  Result<Process> process = Process::start(words, log);
  if (!process) return process.error();
  release_device(SIGKILL);
  device_ = std::move(*process);
  return {};
}

Result<void> Supervisor::start_run() {
  const auto& file = session_folder_;
  std::vector<std::string> words = {settings_.programs / "trocar-run", scene_file_.string(),
                                    "--quiet"};
  const auto add = [&words](const char* option, const std::string& value) {
    words.insert(words.end(), {option, value});
  };
  add("--live", live_link());
  add("--recover", "signal");
  add("--clock", request_.clock);
  add("--record", file / "session.csv");
  add("--summary", file / "session.summary.json");
  add("--session-report", file / "session.html");
  // Its operator's seconds would be many more of a session that runs faster than they do.
  if (request_.clock == "real") words.emplace_back("--xray");
  if (!asset_file_.empty()) add("--asset", asset_file_.string());
  if (request_.duration_s) add("--duration", text_line("%.9g", *request_.duration_s));
  if (!request_.force_law.empty()) add("--force-law", request_.force_law);
  const Trainee& trainee = request_.trainee;
  if (!trainee.code.empty()) add("--trainee", trainee.code);
  if (!trainee.course.empty()) add("--course", trainee.course);
  if (trainee.attempt) add("--attempt", std::to_string(*trainee.attempt));
  if (settings_.stiffness_limit_N_per_m)
    add("--stiffness-limit", text_line("%.9g", *settings_.stiffness_limit_N_per_m));
  if (request_.device.name == kSimulator) {
    add("--device", "udp:" + device_endpoint_);
    add("--key-file", file / "key");
    words.emplace_back("--simulated");
  } else {
    add("--device", request_.device.name);
    words.insert(words.end(), request_.device.words.begin(), request_.device.words.end());
  }
  if (const auto ok = Process::start(words, log_file()).into(run_); !ok) return ok.error();
  Result<void> noted = note_device();
  if (!noted) run_->signal(SIGKILL);
  return noted;
}

Result<void> Supervisor::note_device() {
  std::optional<DeviceNote> note;
  if (device_) note = DeviceNote{device_->pid(), device_->start_ticks(), device_endpoint_};
  return write_device_note(session_folder_ / "console.json", request_.device.name, note);
}

void Supervisor::release_device(int signal) {
  if (!device_) return;
  device_->signal(signal);
  ending_devices_.push_back({std::move(*device_), Clock::now()});
  device_.reset();
}

void Supervisor::adopt_device() {
  const auto note = read_device_note(session_folder_ / "console.json");
  if (!note) return;
  device_ = Process::adopt(static_cast<pid_t>(note->pid), note->start_ticks);
  device_endpoint_ = note->endpoint;
}

/// Replaces the session by one that this console has not started. It was found by its link.
void Supervisor::adopt_session(Process process, std::unique_ptr<TelemetryReader> reader) {
  const pid_t pid = process.pid();
  run_ = std::move(process);
  waits_for_device_ = recover_when_ready_ = is_start_stopped_ = is_started_here_ = false;
  request_ = {};
  request_.device.name.clear();
  attach(std::move(reader));
  const SessionAbout& about = telemetry_.about();
  // Relative names are relative to the folder in which the session was started.
  std::error_code error;
  const std::filesystem::path there =
      std::filesystem::read_symlink("/proc/" + std::to_string(pid) + "/cwd", error);
  const auto resolved = [&there](const std::string& name) {
    return name.empty() ? std::filesystem::path() : (there / name).lexically_normal();
  };
  scene_file_ = resolved(about.scene);
  asset_file_ = resolved(about.asset);
  const std::filesystem::path record = resolved(about.record);
  session_folder_.clear();
  release_device(SIGTERM);
  request_.clock = about.clock;
  if (is_ours() && record.parent_path().parent_path() == settings_.sessions) {
    session_folder_ = record.parent_path();
    adopt_device();
  }
}

void Supervisor::search_session(Clock::time_point now) {
  // If this console has just started a session, the session's link will appear soon.
  const bool is_started = run_ && !telemetry_.is_attached() && !run_->has_ended();
  if (settings_.folder.empty() && settings_.attach.empty()) return;
  if (!is_started && now - searched_at_ < kSearchEvery) return;
  searched_at_ = now;
  const pid_t pid = pid_of_link(live_link());
  if (pid == 0 || (is_started && pid != run_->pid())) return;
  if (!is_started && run_ && run_->pid() == pid) return;  // this session has ended
  // The process is opened before its memory, so the memory cannot belong to another process.
  std::optional<Process> process = is_started ? std::nullopt : Process::adopt(pid);
  if (!is_started && !process) return;
  auto reader = TelemetryReader::open(live_link());
  if (!reader || pid_of_link(live_link()) != pid) return;
  if (is_started) return attach(std::move(*reader));
  adopt_session(std::move(*process), std::move(*reader));
}

void Supervisor::attach(std::unique_ptr<TelemetryReader> reader) {
  telemetry_.attach(std::move(reader));
  if (request_.device.name.empty()) request_.device.name = telemetry_.about().device;
  ending_since_.reset();
  stop_check_.reset();
  is_emergency_stopped_ = false;
  set_state(RunState::kRunning, "runs");
}

Result<void> Supervisor::command(TelemetryCommand command) {
  // A session that this console has not started may run beside a test or the making of a scene.
  const bool is_stop = command == TelemetryCommand::kStop;
  const bool ends_other = is_stop && (test_.is_running() || scene_maker_.is_running());
  if (is_stop) {
    test_.stop(Clock::now());
    scene_maker_.stop(Clock::now());
  }
  if (is_stop && stop_start()) return {};
  const bool is_over = !run_ || run_->has_ended();
  // A session whose telemetry has ended still writes its files, and ends by itself.
  if (is_stop && !is_over && telemetry_.has_ended()) {
    is_emergency_stopped_ = false;
    return {};
  }
  if (!telemetry_.is_attached() || telemetry_.has_ended() || is_over)
    return ends_other ? Result<void>{} : refused("no session runs");
  if (command == TelemetryCommand::kRecover && device_ && device_->has_ended()) {
    // The drive is started first; the command follows when it is ready.
    if (auto ok = start_device(device_endpoint_); !ok) return ok;
    if (auto ok = note_device(); !ok) return ok;
    recover_when_ready_ = true;
    started_at_ = Clock::now();
    return {};
  }
  if (command == TelemetryCommand::kPause || command == TelemetryCommand::kZero)
    recover_when_ready_ = false;
  telemetry_.command(command);
  if (is_stop) is_emergency_stopped_ = false;
  // A stop that is repeated does not give the session more time.
  if (command == TelemetryCommand::kEmergencyStop && !stop_check_)
    stop_check_ = StopCheck{Clock::now() + kZeroWithin, telemetry_.value("ticks")};
  return {};
}

Result<void> Supervisor::xray(XrayRequest request) {
  if (!telemetry_.is_attached() || telemetry_.has_ended() || !run_ || run_->has_ended())
    return refused("no session runs");
  if (!telemetry_.about().takes_xray)
    return refused("this session takes no X-ray; it was started without --xray");
  if (request != XrayRequest::kEnd && telemetry_.value("paused") != 0)
    return refused("the session is paused; no picture is taken");
  if (request == XrayRequest::kShot)
    telemetry_.command(TelemetryCommand::kXrayShot);
  else
    telemetry_.screen(request == XrayRequest::kScreen);
  return {};
}

Result<void> Supervisor::emergency_stop() {
  if (test_.is_running()) {
    test_.stop(Clock::now());
    if (!is_live()) return {};
  }
  recover_when_ready_ = false;
  if (stop_start()) return {};
  is_emergency_stopped_ = true;
  return command(TelemetryCommand::kEmergencyStop);
}

bool Supervisor::stop_start() {
  if (run_ && !run_->has_ended() && !telemetry_.is_attached()) {
    run_->signal(SIGKILL);  // the session renders no torques yet, and must not begin to
    is_start_stopped_ = true;
    return true;
  }
  if (!waits_for_device_) return false;
  waits_for_device_ = false;
  device_->signal(SIGKILL);
  set_state(RunState::kIdle, "stopped before it began");
  return true;
}

void Supervisor::check_stop(Clock::time_point now) {
  if (!stop_check_) return;
  // The stop also ends a pause, so ticks go on.
  bool is_zero = telemetry_.value("ticks") > stop_check_->ticks || telemetry_.value("ended") != 0;
  for (std::size_t motor = 0; motor < kTorqueColumns; ++motor)
    is_zero = is_zero && telemetry_.value("tau_Nm", motor) == 0;
  // A device that measures its own pose states no torques of motors.
  for (std::size_t i = 0; i < kWrenchColumns; ++i)
    is_zero = is_zero && telemetry_.value("wrench_delivered", i) == 0;
  if (is_zero || telemetry_.has_ended()) {
    stop_check_.reset();
  } else if (now > stop_check_->until) {
    stop_check_.reset();
    std::fprintf(stderr,
                 "trocar-console: the torques were not zero within 100 ms of an emergency stop: "
                 "the session is killed\n");
    if (run_) run_->signal(SIGKILL);
  }
}

void Supervisor::poll_device(Clock::time_point now) {
  if (waits_for_device_) {
    device_endpoint_ = ready_endpoint(log_file(), device_log_from_);
    if (!device_endpoint_.empty()) {
      waits_for_device_ = false;
      if (const auto ok = start_run(); !ok) set_state(RunState::kIdle, ok.error().message);
    } else if (device_->has_ended() || now - started_at_ > kDeviceWithin) {
      device_->signal(SIGKILL);
      waits_for_device_ = false;
      const std::string said = last_line(log_file());
      const auto code = static_cast<ExitCode>(device_->exit_code().value_or(0));
      set_state(RunState::kIdle, "the device process did not start: " +
                                     (said.empty() ? reason_of(code, session_folder_) : said));
    }
  }
  if (recover_when_ready_ && !ready_endpoint(log_file(), device_log_from_).empty()) {
    recover_when_ready_ = false;
    (void)command(TelemetryCommand::kRecover);
  }
  // A child that has ended stays in the system's process table until its end is read.
  std::erase_if(ending_devices_, [](EndingDevice& device) { return device.process.has_ended(); });
}

void Supervisor::poll(Clock::time_point now) {
  poll_device(now);
  test_.poll(now);
  scene_maker_.poll(now);
  if (!telemetry_.is_attached() || (run_ && run_->has_ended() && !is_live())) search_session(now);
  const bool is_over = run_ && run_->has_ended();
  if (telemetry_.is_attached()) {
    telemetry_.poll();
    check_stop(now);
    measure_silence(now);
  }
  if (is_over) {
    if (is_live()) on_end();
  } else if (telemetry_.is_attached() && !telemetry_.has_ended()) {
    show_running();
  }
}

void Supervisor::measure_silence(Clock::time_point now) {
  const bool is_new = telemetry_.snapshots() != heard_ || !telemetry_.snapshot();
  const auto passed = std::min<Clock::duration>(now - polled_at_, kLongestPoll);
  silence_ = is_new ? Clock::duration{} : silence_ + passed;
  heard_ = telemetry_.snapshots();
  polled_at_ = now;
}

void Supervisor::show_running() {
  if (silence_ >= kSilentAfter)
    set_state(RunState::kSilent, "the session has stated nothing for more than 0.2 s");
  else if (telemetry_.value("paused") != 0)
    set_state(RunState::kPaused, "paused");
  else
    set_state(RunState::kRunning, "runs");
}

void Supervisor::on_end() {
  stop_check_.reset();
  recover_when_ready_ = false;
  release_device(SIGTERM);
  if (is_start_stopped_) return set_state(RunState::kIdle, "stopped before it began");
  const std::string end = run_->end();
  if (telemetry_.has_ended() || run_->exit_code()) {
    const int code = run_->exit_code().value_or(0);
    if (code == 0) {
      const bool is_killed = !run_->exit_code() && !end.empty();
      return set_state(RunState::kEnded, is_killed
                                             ? "ended, but its process was killed (" + end +
                                                   ") before its recording and report were complete"
                                             : "ended");
    }
    const std::string line = last_line(log_file());
    set_state(RunState::kEnded,
              "ended with " + end + ": " +
                  (line.empty() ? reason_of(static_cast<ExitCode>(code), session_folder_) : line));
  } else {
    set_state(RunState::kLost,
              "the session's process is gone" + (end.empty() ? "" : " (" + end + ")"));
  }
}

bool Supervisor::end_all(Clock::time_point now, Clock::duration patience) {
  bool all = true;
  if (!ending_since_) {
    ending_since_ = now;
    waits_for_device_ = false;
    if (is_started_here_) {
      if (telemetry_.is_attached()) telemetry_.command(TelemetryCommand::kStop);
      if (run_) run_->signal(SIGINT);
    } else if (is_live()) {
      std::fprintf(stderr,
                   "trocar-console: the session of process %d goes on, because this console has "
                   "not started it\n",
                   static_cast<int>(run_->pid()));
    }
    test_.stop(now);
    scene_maker_.stop(now);
  }
  const bool is_late = now - *ending_since_ > patience;
  if (!is_started_here_) {
    // Its device process goes on, too.
  } else if (run_ && !run_->has_ended()) {
    all = false;
    if (is_late) run_->signal(SIGKILL);
  } else {
    release_device(SIGTERM);
  }
  // However late the session has ended, a device gets time to end well.
  for (const EndingDevice& device : ending_devices_) {
    if (is_late && now - device.asked_at > patience) device.process.signal(SIGKILL);
  }
  return all && ending_devices_.empty() && !test_.is_running() && !scene_maker_.is_running();
}

}  // namespace trocar::runtime
