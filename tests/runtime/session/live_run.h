// SPDX-License-Identifier: Apache-2.0
// Runs a session that is shown in memory, and gives it commands as a console does.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <span>
#include <stdexcept>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "formats/session/telemetry.h"
#include "tests/runtime/session/test_session.h"

namespace trocar::runtime::testing_support {

/// Values that another process reads, by name.
class Console {
 public:
  explicit Console(const std::filesystem::path& link) {
    auto reader = TelemetryReader::open(link);
    if (!reader) throw std::runtime_error(reader.error().message);
    reader_ = std::move(*reader);
    about = nlohmann::json::parse(reader_->about());
    std::size_t at = 0;
    for (const auto& column : about["columns"]) {
      place_[column["name"]] = at;
      at += column["count"].get<std::size_t>();
    }
    EXPECT_EQ(at, reader_->columns());
  }
  void give(TelemetryCommand command) { reader_->command(command); }
  double value(const std::string& name, std::size_t i = 0) {
    reader_->snapshot(values_);
    return values_.at(place_.at(name) + i);
  }
  /// Takes what came since the last call.
  void take_events() {
    TelemetryEvent event;
    std::uint64_t lost = 0;
    for (;;) {
      const TelemetryReader::Next next = reader_->next_event(event, lost);
      if (next == TelemetryReader::Next::kNone) return;
      ASSERT_EQ(next, TelemetryReader::Next::kEvent);
      events.push_back(event);
    }
  }
  bool has(TelemetryEventKind kind) {
    take_events();
    return std::any_of(events.begin(), events.end(),
                       [&](const TelemetryEvent& event) { return event.kind == kind; });
  }
  TelemetryReader& reader() { return *reader_; }

  nlohmann::json about;
  std::vector<TelemetryEvent> events;

 private:
  std::unique_ptr<TelemetryReader> reader_;
  std::map<std::string, std::size_t> place_;
  std::vector<double> values_;
};

struct LiveRun {
  SessionResult report;
  std::vector<RecordingRow> rows;
  std::string recording;
  std::vector<TelemetryEvent> events;
};

/// Called after each tick on the haptic thread; `tick` counts from 1.
using AfterTick = std::function<void(std::uint64_t tick, Console& console)>;
/// Called meanwhile on another thread.
using Meanwhile = std::function<void(Console& console)>;

struct Manner {
  Clock clock = Clock::kVirtual;
  RecoveryPolicy recovery = RecoveryPolicy::kNever;
  bool is_live = true;
  AfterTick after_tick;
  Meanwhile meanwhile;
  std::atomic<bool>* recover = nullptr;
  std::span<const RecordingRow> replay;
};

inline LiveRun run(const Scene& scene, const Manner& how) {
  TestSession session(scene, 3);
  SessionOptions& options = session.options;
  options.clock = how.clock;
  options.recovery = how.recovery;
  options.recover = how.recover;
  options.replay = how.replay;
  options.black_box = session.folder.path();
  if (how.is_live)
    options.telemetry = TelemetryOptions{session.folder / "live", "scene.json", "x", "y", {}};
  session.prepare();
  std::unique_ptr<Console> console, other;
  if (how.is_live) {
    console = std::make_unique<Console>(options.telemetry->file);
    other = std::make_unique<Console>(options.telemetry->file);
  }
  std::thread thread([&] {
    if (how.meanwhile) how.meanwhile(*other);
  });
  std::uint64_t tick = 0;
  LiveRun finished;
  session.simulate();
  ReplayDevice replayed(how.replay);
  Device& device = how.replay.empty() ? static_cast<Device&>(*session.device) : replayed;
  finished.report = session.run(device, [&](double dt_s) {
    session.device->step(dt_s);
    ++tick;
    if (how.after_tick) how.after_tick(tick, *console);
  });
  thread.join();
  EXPECT_EQ(tick, finished.report.ticks) << "the device's time moves with the ticks only";
  if (console) {
    console->take_events();
    finished.events = console->events;
    EXPECT_FALSE(std::filesystem::exists(options.telemetry->file)) << "the link is removed";
  }
  finished.rows = session.rows();
  finished.recording = session.recording();
  return finished;
}

inline std::size_t count(const std::vector<TelemetryEvent>& events, TelemetryEventKind kind) {
  return static_cast<std::size_t>(
      std::count_if(events.begin(), events.end(),
                    [&](const TelemetryEvent& event) { return event.kind == kind; }));
}

inline bool is_zero(const RecordingRow& row) {
  return std::all_of(row.tau_Nm.begin(), row.tau_Nm.end(), [](double tau) { return tau == 0; });
}

/// Time goes on without a gap, and a replay gives the same torques.
inline void expect_whole(const Scene& scene, const LiveRun& finished, double rate_Hz = 1000) {
  ASSERT_EQ(finished.rows.size(), finished.report.ticks);
  for (std::size_t k = 0; k < finished.rows.size(); ++k)
    ASSERT_EQ(finished.rows[k].t_s, static_cast<double>(k) / rate_Hz);
  Manner how;
  how.is_live = false;
  how.replay = finished.rows;
  const LiveRun again = run(scene, how);
  EXPECT_EQ(again.report.replay_first_difference, -1);
  EXPECT_EQ(again.report.ticks, finished.report.ticks);
  EXPECT_EQ(again.recording, finished.recording);
}

/// Down to 5 mm into a sheet that holds, and up again.
inline Scene press_scene() {
  Scene scene = test::descent_scene({0.12}, 0.13, 0.115, 0.1);
  scene.tissue.threshold_N = 1000;
  scene.hand.trajectory = {{0, {0, 0, 0.13}, {}},    {0.2, {0, 0, 0.13}, {}},
                           {0.4, {0, 0, 0.115}, {}}, {0.6, {0, 0, 0.115}, {}},
                           {0.8, {0, 0, 0.13}, {}},  {1.6, {0, 0, 0.13}, {}}};
  scene.duration_s = 1.6;
  return scene;
}

/// Gives the command after the tick.
inline AfterTick at(std::map<std::uint64_t, TelemetryCommand> commands) {
  return [commands = std::move(commands)](std::uint64_t tick, Console& console) {
    if (const auto found = commands.find(tick); found != commands.end())
      console.give(found->second);
  };
}

}  // namespace trocar::runtime::testing_support
