// SPDX-License-Identifier: Apache-2.0
// The one session that a console shows: starts its programs or finds one that runs, reads its live
// memory, keeps its events, passes commands on. What pages get of it is here ready to be sent.
#pragma once

#include <chrono>
#include <cstdint>
#include <deque>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "formats/base/result.h"
#include "formats/session/live_memory.h"
#include "runtime/console/process.h"

namespace trocar::runtime {

using Frame = std::shared_ptr<const std::string>;

enum class RunState : std::uint8_t { kIdle, kStarting, kRunning, kPaused, kEnded, kLost };
const char* to_string(RunState state) noexcept;

struct StartRequest {
  std::filesystem::path scene, asset;  ///< asset: empty: the scene's
  std::optional<double> duration_s;
  std::string device;          ///< "inproc", "sim" or a device URI
  std::string clock = "real";  ///< or "virtual"
  std::string force_law;       ///< empty: the scene's
};

class Supervisor {
 public:
  using Clock = std::chrono::steady_clock;
  struct Settings {
    std::filesystem::path folder;    ///< empty: playback, no session
    std::filesystem::path attach;    ///< a live link to look at, instead of sessions of its own
    std::filesystem::path programs;  ///< folder of trocar-run and trocar-device-sim
    std::string device = "inproc";   ///< of sessions that name none
  };
  explicit Supervisor(Settings settings);

  /// Refused: a session runs, or a program cannot be started.
  Result<void> start(const StartRequest& request);
  /// Refused: there is no session.
  Result<void> command(LiveCommand command);
  /// The command, and force if ticks do not show torques of zero soon.
  Result<void> emergency_stop();
  /// Ends sessions of this console: with a command first, by force `patience` later. True: all have
  /// ended.
  bool end_all(Clock::time_point now, Clock::duration patience);

  /// To be called every few milliseconds; reads what is new. Takes less than a millisecond, but for
  /// sheets that were cut: at most two of them at a time.
  void poll(Clock::time_point now);

  // What pages get. A number that has changed means that there is something new.

  struct Event {
    std::uint64_t number = 0;
    std::string json;
  };
  struct Mesh {
    std::uint64_t version = 0;
    Frame frame;  ///< without kind and number; null: nothing to show
  };
  std::uint64_t sessions() const noexcept { return sessions_; }  ///< that were seen
  const std::string& about() const noexcept { return about_; }   ///< JSON; empty: no session yet
  const std::string& id() const noexcept { return id_; }
  const std::string& columns() const noexcept { return columns_; }  ///< JSON
  const std::deque<Event>& events() const noexcept { return events_; }
  std::uint64_t last_event() const noexcept { return last_event_; }
  std::uint64_t state_version() const noexcept { return state_version_; }
  RunState state() const noexcept { return state_; }
  const std::string& state_json() const noexcept { return state_json_; }
  std::uint64_t snapshots() const noexcept { return snapshots_; }
  Frame snapshot();
  const std::vector<Mesh>& sheets() const noexcept { return sheets_; }
  const Mesh& shape() const noexcept { return shape_; }

  /// Of the present or last session.
  const std::filesystem::path& scene_file() const noexcept { return scene_file_; }
  const std::filesystem::path& asset_file() const noexcept { return asset_file_; }
  std::filesystem::path log_file() const;

 private:
  struct Watch {  ///< of an emergency stop
    Clock::time_point until;
    double ticks = 0;
  };

  Result<void> start_run();
  /// Lets a later console find the device process.
  Result<void> note_device();
  Result<void> start_device(const std::string& endpoint);
  void look_for_session(Clock::time_point now);
  void attach(std::unique_ptr<LiveReader> reader);
  void adopt_device();
  void let_device_go(int signal);
  void read_events();
  void read_meshes();
  void watch_stop(Clock::time_point now);
  void say(RunState state, const std::string& message);
  double value(const char* column, std::size_t at = 0) const;
  std::string last_line() const;
  std::filesystem::path live_link() const;
  bool is_ours() const noexcept { return settings_.attach.empty(); }
  std::string relative(const std::filesystem::path& file) const;

  Settings settings_;
  StartRequest request_;  ///< the present or last one
  bool waits_for_device_ = false;
  std::filesystem::path session_folder_;
  std::optional<Process> run_, device_;
  std::vector<Process> leaving_;  ///< devices that were told to end
  std::string device_endpoint_;
  std::uint64_t device_log_from_ = 0;
  Clock::time_point started_at_, looked_at_;
  std::unique_ptr<LiveReader> reader_;
  std::optional<Clock::time_point> ending_since_;
  std::optional<Watch> watch_;
  bool has_ended_ = false;  ///< its last event was read
  bool recover_when_ready_ = false;

  std::uint64_t sessions_ = 0, last_event_ = 0, state_version_ = 0, snapshots_ = 0;
  std::string about_, id_, columns_;
  std::filesystem::path scene_file_, asset_file_;
  std::vector<std::pair<std::string, std::size_t>> places_;  ///< of columns in a snapshot
  std::deque<Event> events_;
  RunState state_ = RunState::kIdle;
  std::string state_json_, message_;
  std::vector<double> values_;
  Frame snapshot_;
  std::uint64_t snapshot_made_ = 0;
  std::vector<Mesh> sheets_;
  std::vector<std::int32_t> slices_;  ///< of the sheets
  Mesh shape_;
};

}  // namespace trocar::runtime
