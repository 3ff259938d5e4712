// SPDX-License-Identifier: Apache-2.0
#include "runtime/console/supervisor.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <ctime>
#include <fstream>
#include <initializer_list>
#include <iterator>
#include <nlohmann/json.hpp>
#include <system_error>
#include <utility>

#include "formats/base/file_io.h"
#include "formats/base/json_text.h"
#include "runtime/console/messages.h"

namespace trocar::runtime {
namespace {

using nlohmann::json;

// An event is some 300 bytes here, so that a session of any length takes at most some 6 MB.
constexpr std::size_t kMostEvents = 20'000;
constexpr int kEventsOfPoll = 512;
constexpr int kSheetsOfPoll = 2;
constexpr auto kZeroWithin = std::chrono::milliseconds(100);
constexpr auto kLookEvery = std::chrono::milliseconds(100);
constexpr auto kDeviceWithin = std::chrono::seconds(10);
constexpr std::uint64_t kMostLog = std::uint64_t{64} << 10;
constexpr const char* kAnyPort = "127.0.0.1:0";

json parsed(std::string_view text) {
  json value = json::parse(text, nullptr, false);
  return value.is_object() ? value : json::object();
}

std::string text_of(const json& object, const char* key) {
  const auto found = object.find(key);
  return found != object.end() && found->is_string() ? found->get<std::string>() : "";
}

std::int64_t whole_of(const json& object, const char* key) {
  const auto found = object.find(key);
  return found != object.end() && found->is_number_integer() ? found->get<std::int64_t>() : 0;
}

/// "2026-11-22T03-04-05-NAME": local time, and a name without what needs quoting.
std::string folder_name(const std::filesystem::path& scene) {
  const std::time_t now = std::time(nullptr);
  std::tm local{};
  ::localtime_r(&now, &local);
  std::array<char, 32> date{};
  std::strftime(date.data(), date.size(), "%Y-%m-%dT%H-%M-%S-", &local);
  std::string name = scene.stem().string().substr(0, 64);
  std::replace_if(
      name.begin(), name.end(),
      [](char c) {
        return !((c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ||
                 c == '_' || c == '-');
      },
      '_');
  return date.data() + name;
}

/// The endpoint that a device process says that it is ready on, after `from` bytes of its log.
std::string ready_endpoint(const std::filesystem::path& log, std::uint64_t from) {
  constexpr std::string_view kReady = "ready on ";
  std::ifstream in(log, std::ios::binary);
  in.seekg(static_cast<std::streamoff>(from));
  std::string text(4096, '\0');
  in.read(text.data(), static_cast<std::streamsize>(text.size()));
  text.resize(static_cast<std::size_t>(in.gcount()));
  const std::size_t at = text.find(kReady), end = text.find('\n', at);
  return at == std::string::npos || end == std::string::npos
             ? ""
             : text.substr(at + kReady.size(), end - at - kReady.size());
}

/// Of a link to /proc/PID/fd/N; 0: it is none.
pid_t pid_of_link(const std::filesystem::path& link) {
  constexpr std::string_view kProc = "/proc/";
  std::error_code error;
  const std::string target = std::filesystem::read_symlink(link, error).string();
  pid_t pid = 0;
  if (!error && target.starts_with(kProc))
    std::from_chars(target.data() + kProc.size(), target.data() + target.size(), pid);
  return pid;
}

}  // namespace

const char* to_string(RunState state) noexcept {
  switch (state) {
    case RunState::kIdle:
      return "idle";
    case RunState::kStarting:
      return "starting";
    case RunState::kRunning:
      return "running";
    case RunState::kPaused:
      return "paused";
    case RunState::kEnded:
      return "ended";
    case RunState::kLost:
      return "lost";
  }
  return "";
}

Supervisor::Supervisor(Settings settings) : settings_(std::move(settings)) {
  say(RunState::kIdle, "no session");
}

std::filesystem::path Supervisor::live_link() const {
  return is_ours() ? settings_.folder / "sessions" / "live" : settings_.attach;
}

std::filesystem::path Supervisor::log_file() const {
  return session_folder_.empty() ? std::filesystem::path() : session_folder_ / "log.txt";
}

std::string Supervisor::relative(const std::filesystem::path& file) const {
  return settings_.folder.empty() ? "" : file.lexically_relative(settings_.folder).string();
}

void Supervisor::say(RunState state, const std::string& message) {
  if (state == state_ && message == message_ && !state_json_.empty()) return;
  state_ = state;
  message_ = message;
  json out = {{"state", to_string(state)}, {"message", message}};
  if (state == RunState::kEnded || state == RunState::kLost) {
    if (run_ && run_->exit_code()) out["exit_code"] = *run_->exit_code();
    std::error_code ignored;
    for (const auto& [key, name] :
         {std::pair("report", "session.html"), std::pair("recording", "session.csv")}) {
      if (!session_folder_.empty() && std::filesystem::exists(session_folder_ / name, ignored))
        out[key] = relative(session_folder_ / name);
    }
  }
  state_json_ = json_text(out);
  ++state_version_;
}

std::string Supervisor::last_line() const {
  std::ifstream in(log_file(), std::ios::binary);
  std::string line, last;
  std::uint64_t read = 0;
  while (std::getline(in, line) && (read += line.size()) < kMostLog) {
    if (!line.empty()) last = line;
  }
  return last.substr(0, 400);
}

Result<void> Supervisor::start(const StartRequest& request) {
  if (settings_.folder.empty()) return refused("this console plays recordings");
  if (!is_ours()) return refused("this console only looks at " + settings_.attach.string());
  if (state_ == RunState::kStarting || state_ == RunState::kRunning ||
      state_ == RunState::kPaused || (run_ && !run_->has_ended()))
    return refused("a session runs already; stop it first");
  const std::filesystem::path sessions = settings_.folder / "sessions";
  std::error_code error;
  if (std::filesystem::is_symlink(sessions, error))
    return refused(sessions.string() + ": is a link");
  const std::string name = folder_name(request.scene);
  std::filesystem::create_directories(sessions, error);
  constexpr int kMostOfASecond = 100;
  bool made = false;
  for (int i = 1; i < kMostOfASecond && !made && !error; ++i) {
    session_folder_ = sessions / (i == 1 ? name : name + "-" + std::to_string(i));
    made = std::filesystem::create_directory(session_folder_, error);
  }
  if (!made) return unwritable(session_folder_.string() + ": cannot be made: " + error.message());
  request_ = request;
  if (request_.device.empty()) request_.device = settings_.device;
  scene_file_ = request.scene;
  asset_file_ = request.asset;
  run_.reset();
  let_device_go(SIGTERM);
  reader_.reset();
  device_endpoint_.clear();
  started_at_ = Clock::now();
  waits_for_device_ = request_.device == "sim";
  Result<void> started = waits_for_device_ ? start_device(kAnyPort) : start_run();
  if (!started) {
    waits_for_device_ = false;
    say(RunState::kIdle, started.error().message);
    return started;
  }
  say(RunState::kStarting, "starting " + request.scene.filename().string());
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
                                    session_folder_ / "key"};
  if (request_.clock == "virtual") {
    words.emplace_back("--clock");
    words.emplace_back("lock-step");
  }
  Result<Process> process = Process::start(words, log);
  if (!process) return process.error();
  let_device_go(SIGKILL);
  device_ = std::move(*process);
  return {};
}

Result<void> Supervisor::start_run() {
  const auto& file = session_folder_;
  std::vector<std::string> words = {settings_.programs / "trocar-run",
                                    scene_file_.string(),
                                    "--live",
                                    live_link(),
                                    "--recover",
                                    "signal",
                                    "--clock",
                                    request_.clock,
                                    "--record",
                                    file / "session.csv",
                                    "--summary",
                                    file / "session.summary.json",
                                    "--session-report",
                                    file / "session.html",
                                    "--quiet"};
  const auto add = [&words](const char* option, const std::string& value) {
    words.emplace_back(option);
    words.push_back(value);
  };
  if (!asset_file_.empty()) add("--asset", asset_file_.string());
  if (request_.duration_s) {
    std::array<char, 32> text{};
    std::snprintf(text.data(), text.size(), "%.9g", *request_.duration_s);
    add("--duration", text.data());
  }
  if (!request_.force_law.empty()) add("--force-law", request_.force_law);
  if (request_.device == "sim") {
    add("--device", "udp:" + device_endpoint_);
    add("--key-file", file / "key");
  } else if (request_.device != "inproc") {
    add("--device", request_.device);
  }
  Result<Process> process = Process::start(words, log_file());
  if (!process) return process.error();
  run_ = std::move(*process);
  return note_device();
}

Result<void> Supervisor::note_device() {
  json about = {{"schema", "trocar.console-session/1"}, {"device", request_.device}};
  if (device_) {
    about["device_pid"] = device_->pid();
    about["device_start_ticks"] = device_->start_ticks();
    about["device_endpoint"] = device_endpoint_;
  }
  return write_file_atomically(session_folder_ / "console.json", json_text(about, 2) + "\n");
}

void Supervisor::let_device_go(int signal) {
  if (!device_) return;
  device_->signal(signal);
  leaving_.push_back(std::move(*device_));
  device_.reset();
}

void Supervisor::adopt_device() {
  const auto bytes = read_file(session_folder_ / "console.json", kMostLog);
  if (!bytes) return;
  const json about = parsed({reinterpret_cast<const char*>(bytes->data()), bytes->size()});
  if (!about.contains("device_pid")) return;
  device_ = Process::adopt(static_cast<pid_t>(whole_of(about, "device_pid")),
                           static_cast<std::uint64_t>(whole_of(about, "device_start_ticks")));
  device_endpoint_ = text_of(about, "device_endpoint");
}

void Supervisor::look_for_session(Clock::time_point now) {
  const bool is_new =
      run_ && !reader_ && !run_->has_ended();  // started by this console: its link appears soon
  if (settings_.folder.empty() && settings_.attach.empty()) return;
  if (!is_new && now - looked_at_ < kLookEvery) return;
  looked_at_ = now;
  const pid_t pid = pid_of_link(live_link());
  if (pid == 0 || (is_new && pid != run_->pid())) return;
  if (!is_new && run_ && run_->pid() == pid) return;  // the one that has ended
  // First the process, then the memory: so the memory is that process's own.
  std::optional<Process> process = is_new ? std::nullopt : Process::adopt(pid);
  if (!is_new && !process) return;
  auto reader = LiveReader::open(live_link());
  if (!reader || pid_of_link(live_link()) != pid) return;
  if (!is_new) run_ = std::move(process);
  attach(std::move(*reader));
  if (is_new) return;
  const json about = parsed(about_);
  // Relative names are those of where it was started.
  std::error_code error;
  const std::filesystem::path there =
      std::filesystem::read_symlink("/proc/" + std::to_string(pid) + "/cwd", error);
  const auto resolved = [&there](const std::string& name) {
    return name.empty() ? std::filesystem::path() : (there / name).lexically_normal();
  };
  scene_file_ = about.contains("scene") && about["scene"].is_object()
                    ? resolved(text_of(about["scene"], "file"))
                    : "";
  asset_file_ = resolved(text_of(about, "asset"));
  const std::filesystem::path record = resolved(text_of(about, "record"));
  session_folder_.clear();
  let_device_go(SIGTERM);
  request_ = {};
  request_.clock = text_of(about, "clock");
  if (is_ours() && record.parent_path().parent_path() == settings_.folder / "sessions") {
    session_folder_ = record.parent_path();
    adopt_device();
  }
}

void Supervisor::attach(std::unique_ptr<LiveReader> reader) {
  reader_ = std::move(reader);
  about_ = reader_->about();
  const json about = parsed(about_);
  // Also if the text is damaged, what pages get is JSON.
  about_ = json_text(about);
  id_ = std::to_string(whole_of(about, "pid")) + "-" + text_of(about, "started_at");
  places_.clear();
  slices_.clear();
  std::size_t place = 0;
  json columns = json::array();
  if (about.contains("columns") && about["columns"].is_array()) {
    for (const json& column : about["columns"]) {
      const std::int64_t count = column.is_object() ? whole_of(column, "count") : 0;
      if (count < 1 || place + static_cast<std::size_t>(count) > reader_->columns()) break;
      places_.emplace_back(text_of(column, "name"), place);
      place += static_cast<std::size_t>(count);
      columns.push_back(column);
    }
  }
  columns_ = json_text(columns);
  if (about.contains("sheets") && about["sheets"].is_array()) {
    for (const json& sheet : about["sheets"])
      slices_.push_back(sheet.is_object() ? static_cast<std::int32_t>(whole_of(sheet, "slice"))
                                          : -1);
  }
  slices_.resize(reader_->sheets(), -1);
  sheets_.assign(reader_->sheets(), {});
  shape_ = {};
  values_.clear();
  snapshot_.reset();
  events_.clear();
  last_event_ = 0;
  has_ended_ = false;
  ending_since_.reset();
  watch_.reset();
  ++sessions_;
  say(RunState::kRunning, "runs");
}

double Supervisor::value(const char* column, std::size_t at) const {
  for (const auto& [name, place] : places_) {
    if (name == column && place + at < values_.size()) return values_[place + at];
  }
  return 0;
}

void Supervisor::read_events() {
  LiveEvent event;
  std::uint64_t lost = 0;
  for (int i = 0; i < kEventsOfPoll; ++i) {
    const LiveReader::Next next = reader_->next_event(event, lost);
    if (next == LiveReader::Next::kNone) return;
    if (next == LiveReader::Next::kLost) continue;  // the next number shows it to pages
    last_event_ = event.number;
    events_.push_back({event.number, event_message(event)});
    if (events_.size() > kMostEvents) events_.pop_front();
    has_ended_ = has_ended_ || event.kind == LiveEventKind::kEnded;
  }
}

void Supervisor::read_meshes() {
  int read = 0;
  for (std::size_t i = 0; i < sheets_.size() && read < kSheetsOfPoll; ++i) {
    const std::uint64_t version = reader_->sheet_version(i);
    LiveSheet sheet;
    if (version == sheets_[i].version || !reader_->sheet(i, sheet)) continue;
    ++read;
    sheets_[i].version = version;
    sheets_[i].frame = sheet.cuts == 0 ? nullptr
                                       : std::make_shared<const std::string>(mesh_message(
                                             static_cast<std::int32_t>(i), sheet.cuts, slices_[i],
                                             sheet.xy_m, 2, sheet.hu, sheet.triangles));
  }
  LiveShape shape;
  const std::uint64_t version = reader_->shape_version();
  if (version != shape_.version && reader_->shape(shape)) {
    shape_.version = version;
    const std::int32_t slice =
        shape.sheet >= 0 && static_cast<std::size_t>(shape.sheet) < slices_.size()
            ? slices_[static_cast<std::size_t>(shape.sheet)]
            : -1;
    shape_.frame = std::make_shared<const std::string>(
        mesh_message(shape.sheet, shape.cuts, slice, shape.xyw, 3, {}, shape.triangles));
  }
}

Frame Supervisor::snapshot() {
  if (snapshot_made_ != snapshots_ || !snapshot_) {
    if (values_.empty()) return nullptr;
    snapshot_ = std::make_shared<const std::string>(snapshot_message(values_));
    snapshot_made_ = snapshots_;
  }
  return snapshot_;
}

Result<void> Supervisor::command(LiveCommand command) {
  if (!reader_ || has_ended_ || !run_ || run_->has_ended()) return refused("no session runs");
  if (command == LiveCommand::kRecover && device_ && device_->has_ended()) {
    // The drive first; the command follows when it is ready.
    if (auto ok = start_device(device_endpoint_); !ok) return ok;
    if (auto ok = note_device(); !ok) return ok;
    recover_when_ready_ = true;
    started_at_ = Clock::now();
    return {};
  }
  reader_->command(command);
  if (command == LiveCommand::kEmergencyStop)
    watch_ = Watch{Clock::now() + kZeroWithin, value("ticks")};
  return {};
}

Result<void> Supervisor::emergency_stop() {
  recover_when_ready_ = false;
  if (run_ && !run_->has_ended() && !reader_) {
    run_->signal(SIGKILL);  // it gives no torques yet, and shall not
    return {};
  }
  if (waits_for_device_) {
    waits_for_device_ = false;
    device_->signal(SIGKILL);
    say(RunState::kIdle, "stopped before it began");
    return {};
  }
  return command(LiveCommand::kEmergencyStop);
}

void Supervisor::watch_stop(Clock::time_point now) {
  if (!watch_) return;
  bool is_zero = value("ticks") > watch_->ticks || value("paused") != 0 || value("ended") != 0;
  for (std::size_t motor = 0; motor < 8; ++motor)
    is_zero = is_zero && value("tau_Nm", motor) == 0;
  if (is_zero || has_ended_) {
    watch_.reset();
  } else if (now > watch_->until) {
    watch_.reset();
    std::fprintf(stderr,
                 "trocar-console: no torques of zero were seen within 100 ms of an emergency stop: "
                 "the session is killed\n");
    if (run_) run_->signal(SIGKILL);
  }
}

void Supervisor::poll(Clock::time_point now) {
  if (waits_for_device_) {
    device_endpoint_ = ready_endpoint(log_file(), device_log_from_);
    if (!device_endpoint_.empty()) {
      waits_for_device_ = false;
      if (const auto ok = start_run(); !ok) say(RunState::kIdle, ok.error().message);
    } else if (device_->has_ended() || now - started_at_ > kDeviceWithin) {
      device_->signal(SIGKILL);
      waits_for_device_ = false;
      say(RunState::kIdle, "the device process did not start: " + last_line());
    }
  }
  if (recover_when_ready_ && !ready_endpoint(log_file(), device_log_from_).empty()) {
    recover_when_ready_ = false;
    (void)command(LiveCommand::kRecover);
  }
  // Ended children stay in the system's table until someone looks.
  std::erase_if(leaving_, [](Process& process) { return process.has_ended(); });
  const bool is_over = run_ && run_->has_ended();
  if (!reader_ || (is_over && state_ != RunState::kRunning && state_ != RunState::kPaused &&
                   state_ != RunState::kStarting))
    look_for_session(now);
  if (reader_) {
    if (reader_->snapshot(values_)) ++snapshots_;
    read_events();
    read_meshes();
    watch_stop(now);
  }
  if (!is_over) {
    if (reader_ && !has_ended_) {
      const bool paused = value("paused") != 0;
      say(paused ? RunState::kPaused : RunState::kRunning, paused ? "paused" : "runs");
    }
    return;
  }
  if (state_ == RunState::kEnded || state_ == RunState::kLost || state_ == RunState::kIdle) return;
  // The session has just ended.
  watch_.reset();
  recover_when_ready_ = false;
  let_device_go(SIGTERM);
  const std::string end = run_->end(), line = last_line();
  if (has_ended_ || run_->exit_code()) {
    const bool is_good = !run_->exit_code() || *run_->exit_code() == 0;
    say(RunState::kEnded, is_good ? "ended" : "ended with " + end + ": " + line);
  } else {
    say(RunState::kLost, "the session's process is gone" + (end.empty() ? "" : " (" + end + ")"));
  }
}

bool Supervisor::end_all(Clock::time_point now, Clock::duration patience) {
  bool all = true;
  if (!ending_since_) {
    ending_since_ = now;
    waits_for_device_ = false;
    if (reader_ && is_ours()) reader_->command(LiveCommand::kStop);
    if (run_ && is_ours()) run_->signal(SIGINT);
  }
  const bool is_late = now - *ending_since_ > patience;
  if (run_ && is_ours() && !run_->has_ended()) {
    all = false;
    if (is_late) run_->signal(SIGKILL);
  } else if (is_ours()) {
    let_device_go(SIGTERM);
  }
  for (const Process& process : leaving_) {
    if (is_late) process.signal(SIGKILL);
  }
  return all && leaving_.empty();
}

}  // namespace trocar::runtime
