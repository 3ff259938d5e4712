// SPDX-License-Identifier: Apache-2.0
// The supervisor of the one session that a console shows. The supervisor starts trocar-run (and, if
// a page asks for it, the simulated device trocar-device-sim), or finds a session that already
// runs. It then follows this session, and passes the commands of pages on to the session.
#pragma once

#include <array>
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "formats/base/result.h"
#include "formats/session/telemetry.h"
#include "formats/session/trainee.h"
#include "runtime/console/device_test.h"
#include "runtime/console/process.h"
#include "runtime/console/session_telemetry.h"

namespace trocar::runtime {

/// The state of the session. kIdle: no session was started, or the last start failed or was
/// stopped. kStarting: a program was started, but there is no telemetry yet. kSilent: the session's
/// process runs, but no new telemetry has come for kSilentAfter. (Telemetry also comes during a
/// pause.) kLost: the process is gone, and neither the event `ended` nor an exit code is known.
enum class RunState : std::uint8_t { kIdle, kStarting, kRunning, kSilent, kPaused, kEnded, kLost };
inline constexpr auto kSilentAfter = std::chrono::milliseconds(200);
const char* to_string(RunState state) noexcept;

/// Requests for X-ray. kShot: take one picture. kScreen: keep continuous X-ray (screening) on for
/// another second. kEnd: switch screening off.
enum class XrayRequest : std::uint8_t { kShot, kScreen, kEnd };

struct StartRequest {
  std::filesystem::path scene;
  std::filesystem::path asset;  ///< empty: the asset that the scene names
  std::optional<double> duration_s;
  DeviceChoice device;
  std::string clock = "real";  ///< "real" or "virtual"
  std::string force_law;       ///< empty: the force law that the scene names
  Trainee trainee;
};

class Supervisor {
 public:
  using Clock = std::chrono::steady_clock;
  struct Settings {
    /// The folder of the scenes; empty: the console only plays a recording.
    std::filesystem::path folder;
    std::filesystem::path sessions;  ///< folder of the sessions' folders; need not exist yet
    /// The link to the shared memory of a running session (trocar-run --live). If it is set, the
    /// console only shows and commands this session. If it is empty, the console starts sessions.
    std::filesystem::path attach;
    std::filesystem::path programs;  ///< folder of trocar-run and trocar-device-sim
    /// The devices that pages may choose, at least one. The first device is the default.
    std::vector<DeviceChoice> devices = {DeviceChoice{}};
    /// Value of trocar-run's option --stiffness-limit in all sessions; none: without this option.
    std::optional<double> stiffness_limit_N_per_m;
  };
  explicit Supervisor(Settings settings);

  /// Starts a session. Errors: kRefused if this console starts no sessions (Settings), if a session
  /// or a device test runs, if a scene is being made, or if a program cannot be started;
  /// kUnwritable if a file of the session cannot be written.
  Result<void> start(const StartRequest& request);
  /// Starts the test of a device. The device gets no force in the test. Errors: those of start();
  /// also kRefused if Trocar itself simulates the device.
  Result<void> test_device(const DeviceChoice& device);
  const DeviceTest& test() const noexcept { return test_; }
  /// Starts to make a scene in the console's folder. Errors: those of start() and of
  /// SceneMaker::start().
  Result<void> make_scene(const NewSceneRequest& request);
  const SceneMaker& scene_maker() const noexcept { return scene_maker_; }
  const std::vector<DeviceChoice>& devices() const noexcept { return settings_.devices; }
  /// Replaces texts that pages must not see: the names of the console's folders, and the file names
  /// in the devices' options.
  const HiddenTexts& hidden() const noexcept { return hidden_; }
  /// Takes an X-ray picture, or switches screening on or off. Screening ends after 1 s unless
  /// kScreen is requested again. Errors: kRefused if no session runs, if the session takes no
  /// X-ray, or if the session is paused (unless the request is kEnd).
  Result<void> xray(XrayRequest request);
  /// Passes a command on to the session. The command `stop` also ends the test of a device, the
  /// making of a scene, and a session that is starting. If the device process of the session has
  /// ended, the command `recover` first starts this process again. Errors: kRefused if there is
  /// nothing to command or to stop, or if the device process cannot be started; kUnwritable if the
  /// note about this process (DeviceNote) cannot be written.
  Result<void> command(TelemetryCommand command);
  /// True if is_live() is true and the session has a live hand. Only then may move_hand() be
  /// called.
  bool has_hand() const noexcept { return telemetry_.has_hand() && is_live(); }
  /// Sets the target of the live hand: the position of the tip in {B} in m, and the rotation vector
  /// of the plate in rad. If `target` is nullopt, the hand lets go. Precondition: has_hand().
  void move_hand(const std::optional<std::array<double, 6>>& target) {
    telemetry_.move_hand(target);
  }
  /// Sends the emergency stop. If the telemetry does not show zero torques within 100 ms, poll()
  /// kills the session's process. If the session was started but has no telemetry yet, its process
  /// is killed immediately. The test of a device is stopped. Errors: kRefused if neither a session
  /// nor a test runs.
  Result<void> emergency_stop();
  /// Ends what this console has started: the session with its device process, a test and the making
  /// of a scene. A session that was found goes on, with its device process. Call this function repeatedly until it returns true; everything that
  /// it ends has then ended. The first call asks the session, the test and the making of a scene to
  /// end. When the session has ended, the device process is asked to end. If the session's process
  /// still runs when `patience` has passed since the first call, the next call kills it. The device
  /// process is killed when `patience` has passed both since the first call and since the device
  /// process was asked to end.
  bool end_all(Clock::time_point now, Clock::duration patience);
  /// Reads telemetry, follows the console's processes, and checks the effect of an emergency stop.
  /// The caller must call this every few milliseconds.
  void poll(Clock::time_point now);

  /// Telemetry of the present session. If no session runs, telemetry of the last session.
  const SessionTelemetry& telemetry() const noexcept { return telemetry_; }
  RunState state() const noexcept { return state_; }
  /// Returns true if the session is starting, runs, is silent or is paused.
  bool is_live() const noexcept {
    return state_ == RunState::kStarting || state_ == RunState::kRunning ||
           state_ == RunState::kSilent || state_ == RunState::kPaused;
  }
  /// The message `state` of protocol.md. Whenever this text changes, state_version() changes, too.
  const std::string& state_json() const noexcept { return state_json_; }
  std::uint64_t state_version() const noexcept { return state_version_; }
  const std::filesystem::path& scene_file() const noexcept { return scene_file_; }
  const std::filesystem::path& asset_file() const noexcept { return asset_file_; }
  std::filesystem::path log_file() const;

 private:
  /// The check of an emergency stop. `ticks`: number of ticks done when the stop was sent. Before
  /// the time `until`, a later tick must show zero torques.
  struct StopCheck {
    Clock::time_point until;
    double ticks = 0;
  };

  /// Checks that a program may be started. Errors: kRefused if this console starts no sessions
  /// (Settings), or if a session, a test or the making of a scene already runs.
  Result<void> check_free();
  /// Kills a session that is starting, and has no telemetry yet. Returns false if there is none.
  bool stop_start();
  Result<void> start_run();
  Result<void> start_device(const std::string& endpoint);
  /// Writes a note about the device process into the session's folder, so that a later console
  /// finds the device process.
  Result<void> note_device();
  void adopt_device();
  void release_device(int signal);
  void search_session(Clock::time_point now);
  void adopt_session(Process process, std::unique_ptr<TelemetryReader> reader);
  void attach(std::unique_ptr<TelemetryReader> reader);
  void poll_device(Clock::time_point now);
  void check_stop(Clock::time_point now);
  void measure_silence(Clock::time_point now);
  void show_running();
  void on_end();
  void set_state(RunState state, const std::string& message);
  std::filesystem::path live_link() const;
  bool is_ours() const noexcept { return settings_.attach.empty(); }

  /// A device process that was asked to end, and the time of that.
  struct EndingDevice {
    Process process;
    Clock::time_point asked_at;
  };

  Settings settings_;
  HiddenTexts hidden_;
  DeviceTest test_;
  SceneMaker scene_maker_;
  StartRequest request_;  ///< request of the present session, or of the last session
  SessionTelemetry telemetry_;
  std::optional<Process> run_, device_;
  std::vector<EndingDevice> ending_devices_;
  bool waits_for_device_ = false, recover_when_ready_ = false;
  bool is_started_here_ = false;   ///< start() has started the session
  bool is_start_stopped_ = false;  ///< stop_start() has killed the session
  /// An emergency stop was sent to the session, and no command `stop` after it. When the session
  /// has ended, the message `state` then has the field `emergency_stop`, so that no page restarts
  /// the session. This also holds if the emergency stop came too late to raise a fault.
  bool is_emergency_stopped_ = false;
  std::string device_endpoint_;
  std::uint64_t device_log_from_ = 0;  ///< byte of the log at which the device's output begins
  Clock::time_point started_at_, searched_at_, polled_at_;
  std::uint64_t heard_ = 0;  ///< SessionTelemetry::snapshots() at the last poll, to detect silence
  Clock::duration silence_{};
  std::optional<Clock::time_point> ending_since_;
  std::optional<StopCheck> stop_check_;
  std::filesystem::path session_folder_, scene_file_, asset_file_;
  RunState state_ = RunState::kIdle;
  std::string state_json_, message_;
  std::uint64_t state_version_ = 0;
};

}  // namespace trocar::runtime
