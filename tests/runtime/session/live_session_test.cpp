// SPDX-License-Identifier: Apache-2.0
// Sessions that are shown in memory and take commands: pause, resume, zero, recover, emergency stop
// and stop; the same recording with and without; no allocation and no lock on the haptic thread.
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <bit>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iterator>
#include <map>
#include <nlohmann/json.hpp>
#include <random>
#include <thread>

#include "formats/session/recording.h"
#include "formats/session/telemetry.h"
#include "runtime/devices/replay_device.h"
#include "runtime/devices/simulated_hand.h"
#include "runtime/realtime/allocation_counter.h"
#include "runtime/session/session.h"
#include "tests/reference/hooks/lock_counter.h"
#include "tests/support/counted_allocations.h"
#include "tests/support/four_legs_session.h"
#include "tests/support/sheet_fixture.h"
#include "tests/support/temporary_folder.h"

namespace trocar::runtime {
namespace {

using std::chrono::milliseconds;
using std::chrono::steady_clock;

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

/// A device with a clock of its own, in real time: it runs whether there are ticks or not.
class ClockedDevice final : public Device {
 public:
  explicit ClockedDevice(SimulatedDevice& inner) : inner_(inner) {}
  DeviceStatus read(DeviceState& state) noexcept override {
    ++reads;
    if (stopped_reads > 0) {
      --stopped_reads;
      return DeviceStatus::kEmergencyStop;
    }
    return inner_.read(state);
  }
  DeviceStatus write(const DeviceCommand& command) noexcept override {
    ++writes;
    const auto& tau = command.tau_motor_Nm;
    is_loaded = std::any_of(tau.begin(), tau.end(), [](double x) { return x != 0; });
    if (is_loaded) ++loaded_writes;
    return inner_.write(command);
  }
  void advance(double dt_s) noexcept override { inner_.step(dt_s); }
  std::atomic<std::uint64_t> reads{0}, writes{0}, loaded_writes{0};
  std::atomic<bool> is_loaded{false};
  std::atomic<int> stopped_reads{0};  ///< number of reads for which its emergency stop is pressed

 private:
  SimulatedDevice& inner_;
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

LiveRun run(const Scene& scene, const Manner& how) {
  const test::TemporaryFolder folder;
  Remesher remesher(*place_slices(scene, test::square_asset(3), "a"));
  auto device = make_simulated_device(scene, default_device_description());
  EXPECT_TRUE(device);
  SessionOptions options;
  options.clock = how.clock;
  options.recovery = how.recovery;
  options.recover = how.recover;
  options.duration_s = scene.duration_s;
  options.limits.gap_max_s = 0;
  options.record = folder / "r.csv";
  options.replay = how.replay;
  options.black_box = folder.path();
  if (how.is_live)
    options.telemetry = TelemetryOptions{folder / "live", "scene.json", "x", "y", {}};
  auto workers = test::make_workers(scene, remesher, options);
  EXPECT_TRUE(workers) << workers.error().message;
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
  const auto advance = [&](double dt_s) {
    device->step(dt_s);
    ++tick;
    if (how.after_tick) how.after_tick(tick, *console);
  };
  if (how.replay.empty()) {
    finished.report = run_session(scene, default_device_description(), remesher, *device, advance,
                                  options, std::move(*workers));
  } else {
    ReplayDevice replayed(how.replay);
    finished.report = run_session(scene, default_device_description(), remesher, replayed, advance,
                                  options, std::move(*workers));
  }
  thread.join();
  EXPECT_EQ(tick, finished.report.ticks) << "the device's time moves with the ticks only";
  if (console) {
    console->take_events();
    finished.events = console->events;
    EXPECT_FALSE(std::filesystem::exists(options.telemetry->file)) << "the link is removed";
  }
  auto rows = read_recording(*options.record);
  EXPECT_TRUE(rows);
  finished.rows = std::move(*rows);
  std::ifstream file(*options.record, std::ios::binary);
  finished.recording.assign(std::istreambuf_iterator<char>(file), {});
  return finished;
}

std::size_t count(const std::vector<TelemetryEvent>& events, TelemetryEventKind kind) {
  return static_cast<std::size_t>(
      std::count_if(events.begin(), events.end(),
                    [&](const TelemetryEvent& event) { return event.kind == kind; }));
}

bool is_zero(const RecordingRow& row) {
  return std::all_of(row.tau_Nm.begin(), row.tau_Nm.end(), [](double tau) { return tau == 0; });
}

/// Time goes on without a gap, and a replay gives the same torques.
void expect_whole(const Scene& scene, const LiveRun& finished, double rate_Hz = 1000) {
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
Scene press_scene() {
  Scene scene = test::descent_scene({0.12}, 0.13, 0.115, 0.1);
  scene.tissue.threshold_N = 1000;
  scene.hand.trajectory = {{0, {0, 0, 0.13}, {}},    {0.2, {0, 0, 0.13}, {}},
                           {0.4, {0, 0, 0.115}, {}}, {0.6, {0, 0, 0.115}, {}},
                           {0.8, {0, 0, 0.13}, {}},  {1.6, {0, 0, 0.13}, {}}};
  scene.duration_s = 1.6;
  return scene;
}

/// Gives the command after the tick.
AfterTick at(std::map<std::uint64_t, TelemetryCommand> commands) {
  return [commands = std::move(commands)](std::uint64_t tick, Console& console) {
    if (const auto found = commands.find(tick); found != commands.end())
      console.give(found->second);
  };
}

/// Waits until the session is paused, checks that its time does not advance, and resumes it.
Meanwhile resume_after(milliseconds time) {
  return [time](Console& console) {
    const auto patience = steady_clock::now() + std::chrono::seconds(60);
    while (!console.has(TelemetryEventKind::kPaused) && steady_clock::now() < patience)
      std::this_thread::sleep_for(milliseconds(1));
    std::this_thread::sleep_for(milliseconds(20));  // for a snapshot with it
    const double ticks = console.value("ticks"), taken_at_s = console.value("taken_at_s");
    EXPECT_EQ(console.value("paused"), 1);
    for (std::size_t i = 0; i < 8; ++i)
      EXPECT_EQ(console.value("tau_Nm", i), 0);
    std::this_thread::sleep_for(time);
    EXPECT_EQ(console.value("ticks"), ticks);
    EXPECT_GT(console.value("taken_at_s"), taken_at_s);
    console.give(TelemetryCommand::kResume);
  };
}

class Paused : public testing::TestWithParam<std::tuple<Clock, RecoveryPolicy>> {};
INSTANTIATE_TEST_SUITE_P(EveryClockAndPolicy, Paused,
                         testing::Combine(testing::Values(Clock::kVirtual, Clock::kReal),
                                          testing::Values(RecoveryPolicy::kNever,
                                                          RecoveryPolicy::kOnRequest,
                                                          RecoveryPolicy::kAuto)));

TEST_P(Paused, HoldsTime) {
  const Scene scene = press_scene();
  Manner how;
  std::tie(how.clock, how.recovery) = GetParam();
  how.after_tick = at({{100, TelemetryCommand::kPause}});
  how.meanwhile = resume_after(milliseconds(150));
  const LiveRun paused = run(scene, how);
  EXPECT_EQ(paused.report.end, SessionEnd::kDone);
  EXPECT_EQ(paused.report.fault, Fault::kNone);
  EXPECT_EQ(paused.report.ticks, 1600U);
  ASSERT_EQ(paused.report.faults.size(), 1U);
  EXPECT_EQ(paused.report.faults[0].fault, Fault::kPaused);
  EXPECT_GT(paused.report.faults[0].recovered_t_s, 0);
  EXPECT_TRUE(paused.report.black_boxes.empty()) << "a pause is no failure";
  EXPECT_EQ(count(paused.events, TelemetryEventKind::kPaused), 1U);
  EXPECT_EQ(count(paused.events, TelemetryEventKind::kResumed), 1U);
  EXPECT_EQ(count(paused.events, TelemetryEventKind::kRecovered), 1U);
  ASSERT_FALSE(paused.events.empty());
  EXPECT_EQ(paused.events.back().kind, TelemetryEventKind::kEnded);
  EXPECT_EQ(paused.events.back().end, TelemetryEnd::kDone);
  // The ramp's rows, and none while paused.
  const auto with_pause =
      std::count_if(paused.rows.begin(), paused.rows.end(),
                    [](const RecordingRow& row) { return row.outside_fault == Fault::kPaused; });
  EXPECT_EQ(with_pause, 4);
  const auto asked = std::find_if(paused.rows.begin(), paused.rows.end(),
                                  [](const RecordingRow& row) { return row.recovery_asked != 0; });
  ASSERT_NE(asked, paused.rows.end());
  EXPECT_EQ((asked - 1)->outside_fault, Fault::kPaused);
  EXPECT_TRUE(is_zero(*(asked - 1)));
  expect_whole(scene, paused);
}

TEST(TelemetrySession, APauseUnderLoadRampsDownAndWaitsForTheToolToBeFree) {
  const Scene scene = press_scene();
  Manner how;
  how.after_tick = at({{500, TelemetryCommand::kPause}});
  how.meanwhile = resume_after(milliseconds(30));
  const LiveRun paused = run(scene, how);
  EXPECT_EQ(paused.report.end, SessionEnd::kDone);
  ASSERT_EQ(paused.report.faults.size(), 1U);
  EXPECT_GT(paused.report.faults[0].recovered_t_s, 0.7) << "the hand lifts the tool at 0.6 s";
  EXPECT_FALSE(is_zero(paused.rows[499]));
  EXPECT_TRUE(is_zero(paused.rows[503]));
  expect_whole(scene, paused);
}

TEST(TelemetrySession, APauseDuringARecoveryBeginsTheQuietTimeAgain) {
  const Scene scene = press_scene();
  Manner how;
  how.after_tick = at({{500, TelemetryCommand::kZero},
                       {850, TelemetryCommand::kRecover},
                       {1090, TelemetryCommand::kPause}});
  how.meanwhile = resume_after(milliseconds(30));
  const LiveRun paused = run(scene, how);
  EXPECT_EQ(paused.rows[1089].safety, SafetyState::kRecovering) << "240 of the 250 ms had passed";
  const auto resumed = std::find_if(
      paused.events.begin(), paused.events.end(),
      [](const TelemetryEvent& event) { return event.kind == TelemetryEventKind::kResumed; });
  ASSERT_NE(resumed, paused.events.end());
  const auto running =
      std::find_if(paused.rows.begin() + 1090, paused.rows.end(),
                   [](const RecordingRow& row) { return row.safety == SafetyState::kRunning; });
  ASSERT_NE(running, paused.rows.end());
  EXPECT_GE(running->t_s, resumed->t_s + 0.25 - 1e-9);
  expect_whole(scene, paused);
}

/// A session of 0.5 s in real time, which is paused after 450 ticks and then resumed. `while_paused`
/// is called in between, with the number of ticks.
SessionResult run_paused(
    const Scene& scene, ClockedDevice& device,
    const std::function<void(Console& console, std::uint64_t ticks)>& while_paused) {
  const test::TemporaryFolder folder;
  Remesher remesher(*place_slices(scene, test::square_asset(3), "a"));
  SessionOptions options;
  options.duration_s = 0.5;
  options.limits.gap_max_s = 0;
  options.telemetry = TelemetryOptions{folder / "live", "", "", "", {}};
  auto workers = test::make_workers(scene, remesher, options);
  EXPECT_TRUE(workers);
  Console console(options.telemetry->file);
  Console other(options.telemetry->file);
  std::uint64_t ticks = 0;
  std::thread thread([&] {
    while (!other.has(TelemetryEventKind::kPaused))
      std::this_thread::sleep_for(milliseconds(1));
    while_paused(other, ticks);
    other.give(TelemetryCommand::kResume);
  });
  const auto advance = [&](double dt_s) {
    device.advance(dt_s);
    if (++ticks == 450) console.give(TelemetryCommand::kPause);
  };
  SessionResult report = run_session(scene, default_device_description(), remesher, device, advance,
                                     options, std::move(*workers));
  thread.join();
  return report;
}

TEST(TelemetrySession, ADeviceWithAClockOfItsOwnIsReadAndGetsZeroTorquesWhilePaused) {
  const Scene scene = press_scene();
  auto simulated = make_simulated_device(scene, default_device_description());
  ASSERT_TRUE(simulated);
  ClockedDevice device(*simulated);
  const SessionResult report =
      run_paused(scene, device, [&](Console& console, std::uint64_t ticks) {
        const std::uint64_t reads = device.reads, writes = device.writes,
                            loaded = device.loaded_writes;
        while (device.writes < writes + 50)
          std::this_thread::sleep_for(milliseconds(1));
        EXPECT_GE(device.reads, reads + 49);
        EXPECT_EQ(device.loaded_writes, loaded);
        EXPECT_EQ(console.value("ticks"), static_cast<double>(ticks));
      });
  EXPECT_EQ(report.ticks, 500U);
  EXPECT_GE(device.writes, 500U + 50U);
}

// The zero torques of the pause acknowledge the stop, so that later states do not report it.
TEST(TelemetrySession, TheDevicesOwnStopDuringAPauseIsLatchedAlthoughItWasReleased) {
  const Scene scene = press_scene();
  auto simulated = make_simulated_device(scene, default_device_description());
  ASSERT_TRUE(simulated);
  ClockedDevice device(*simulated);
  const SessionResult report = run_paused(scene, device, [&](Console&, std::uint64_t) {
    device.stopped_reads = 10;
    while (device.stopped_reads > 0)
      std::this_thread::sleep_for(milliseconds(1));
    const std::uint64_t reads = device.reads;
    while (device.reads < reads + 10)
      std::this_thread::sleep_for(milliseconds(1));
  });
  EXPECT_EQ(report.end, SessionEnd::kFault);
  EXPECT_EQ(report.fault, Fault::kEmergencyStop);
  ASSERT_EQ(report.faults.size(), 2U);
  EXPECT_EQ(report.faults[0].fault, Fault::kPaused);
  EXPECT_EQ(report.faults[1].fault, Fault::kEmergencyStop);
}

TEST(TelemetrySession, ZeroTurnsForcesOffUntilRecoveryIsAskedFor) {
  const Scene scene = press_scene();
  for (const RecoveryPolicy recovery :
       {RecoveryPolicy::kNever, RecoveryPolicy::kOnRequest, RecoveryPolicy::kAuto}) {
    Manner how;
    how.recovery = recovery;
    how.after_tick = at({{500, TelemetryCommand::kZero}, {900, TelemetryCommand::kRecover}});
    const LiveRun off = run(scene, how);
    EXPECT_EQ(off.report.end, SessionEnd::kDone);
    EXPECT_EQ(off.report.ticks, 1600U) << "time goes on";
    ASSERT_EQ(off.report.faults.size(), 1U);
    EXPECT_EQ(off.report.faults[0].fault, Fault::kForcesOff);
    EXPECT_NEAR(off.report.faults[0].recovered_t_s, 0.9 + 0.25, 0.01);
    EXPECT_FALSE(is_zero(off.rows[499]));
    for (std::size_t k = 503; k < 900; ++k) {
      ASSERT_TRUE(is_zero(off.rows[k])) << k;
      ASSERT_EQ(off.rows[k].outside_fault, Fault::kForcesOff);
      ASSERT_EQ(off.rows[k].safety, SafetyState::kFault);
    }
    EXPECT_EQ(off.rows[900].recovery_asked, 1);
    EXPECT_EQ(count(off.events, TelemetryEventKind::kPaused), 0U);
    expect_whole(scene, off);
  }
}

TEST(TelemetrySession, ASessionThatEndsWithForcesOffIsDone) {
  Manner how;
  how.after_tick = at({{500, TelemetryCommand::kZero}});
  const LiveRun off = run(press_scene(), how);
  EXPECT_EQ(off.report.end, SessionEnd::kDone);
  EXPECT_EQ(off.report.fault, Fault::kForcesOff);
}

TEST(TelemetrySession, AnEmergencyStopGivesZeroTorquesWithinTheRampAndATick) {
  const Scene scene = press_scene();
  for (const Clock clock : {Clock::kVirtual, Clock::kReal}) {
    for (const std::uint64_t tick : {401U, 450U, 523U}) {
      Manner how;
      how.clock = clock;
      how.after_tick = at({{tick, TelemetryCommand::kEmergencyStop}});
      const LiveRun stopped = run(scene, how);
      EXPECT_EQ(stopped.report.end, SessionEnd::kFault);
      EXPECT_EQ(stopped.report.fault, Fault::kEmergencyStop);
      ASSERT_FALSE(is_zero(stopped.rows[tick - 1])) << "there was a load";
      const double changed_t_s = static_cast<double>(tick - 1) / 1000;  // or later
      const auto zero = std::find_if(stopped.rows.begin() + static_cast<std::ptrdiff_t>(tick) - 1,
                                     stopped.rows.end(), is_zero);
      ASSERT_NE(zero, stopped.rows.end());
      EXPECT_LE(zero->t_s - changed_t_s, kRampMax_s + 1e-3 + 1e-12);
      EXPECT_TRUE(std::all_of(zero, stopped.rows.end(), is_zero));
      EXPECT_EQ(stopped.report.black_boxes.size(), 1U);
      expect_whole(scene, stopped);
    }
  }
}

TEST(TelemetrySession, AnEmergencyStopAtAnyMomentUnderLoad) {
  const Scene scene = press_scene();
  std::mt19937_64 random(20261122);
  for (int i = 0; i < 20; ++i) {
    const std::uint64_t tick = 400 + random() % 240;
    Manner how;
    how.recovery = RecoveryPolicy::kAuto;
    how.after_tick = at({{tick, TelemetryCommand::kEmergencyStop}});
    const LiveRun stopped = run(scene, how);
    ASSERT_FALSE(is_zero(stopped.rows[tick - 1]));
    EXPECT_TRUE(std::all_of(stopped.rows.begin() + static_cast<std::ptrdiff_t>(tick) + 3,
                            stopped.rows.end(), is_zero))
        << tick;
    double last = 1e9;  // the ramp falls
    for (std::uint64_t k = tick - 1; k < tick + 4; ++k) {
      const auto& tau = stopped.rows[k].tau_Nm;
      const double largest = std::abs(*std::max_element(
          tau.begin(), tau.end(), [](double a, double b) { return std::abs(a) < std::abs(b); }));
      EXPECT_LT(largest, last);
      last = largest;
    }
  }
}

TEST(TelemetrySession, AnEmergencyStopHoldsUntilRecoveryIsAskedFor) {
  const Scene scene = press_scene();
  std::atomic<bool> signal{false};
  for (const RecoveryPolicy recovery : {RecoveryPolicy::kOnRequest, RecoveryPolicy::kAuto}) {
    for (const bool by_signal : {false, true}) {
      if (by_signal && recovery == RecoveryPolicy::kAuto) continue;
      Manner how;
      how.recovery = recovery;
      how.recover = &signal;
      how.after_tick = [&, by_signal](std::uint64_t tick, Console& console) {
        if (tick == 500) console.give(TelemetryCommand::kZero);
        if (tick == 850) console.give(TelemetryCommand::kRecover);
        if (tick == 950) console.give(TelemetryCommand::kEmergencyStop);  // in `recovering`
        if (tick != 1250) return;
        if (by_signal) {
          signal = true;
        } else {
          console.give(TelemetryCommand::kRecover);
        }
      };
      const LiveRun stopped = run(scene, how);
      EXPECT_EQ(stopped.rows[940].safety, SafetyState::kRecovering);
      for (std::size_t k = 950; k < 1250; ++k) {
        ASSERT_TRUE(is_zero(stopped.rows[k])) << k;
        ASSERT_EQ(stopped.rows[k].outside_fault, Fault::kEmergencyStop);
        ASSERT_NE(stopped.rows[k].safety, SafetyState::kRunning);
      }
      EXPECT_EQ(stopped.rows[1250].outside_fault, Fault::kNone);
      EXPECT_EQ(stopped.rows[1550].safety, SafetyState::kRunning);
      expect_whole(scene, stopped);
    }
  }
}

TEST(TelemetrySession, StopEndsItWithTorquesAtZero) {
  for (const Clock clock : {Clock::kVirtual, Clock::kReal}) {
    Manner how;
    how.clock = clock;
    how.after_tick = at({{500, TelemetryCommand::kStop}});
    const LiveRun stopped = run(press_scene(), how);
    EXPECT_EQ(stopped.report.end, SessionEnd::kInterrupted);
    EXPECT_EQ(stopped.report.ticks, 500U);
    EXPECT_EQ(stopped.events.back().kind, TelemetryEventKind::kEnded);
    EXPECT_EQ(stopped.events.back().end, TelemetryEnd::kInterrupted);
  }
}

TEST(TelemetrySession, StopEndsAPause) {
  for (const Clock clock : {Clock::kVirtual, Clock::kReal}) {
    Manner how;
    how.clock = clock;
    how.after_tick = at({{100, TelemetryCommand::kPause}});
    how.meanwhile = [](Console& console) {
      while (!console.has(TelemetryEventKind::kPaused))
        std::this_thread::sleep_for(milliseconds(1));
      console.give(TelemetryCommand::kStop);
    };
    const LiveRun stopped = run(press_scene(), how);
    EXPECT_EQ(stopped.report.end, SessionEnd::kInterrupted);
    EXPECT_EQ(stopped.report.fault, Fault::kPaused);
    EXPECT_EQ(stopped.report.ticks, 104U);
  }
}

TEST(TelemetrySession, AReplayIsPausedWithoutAnyFault) {
  const Scene scene = press_scene();
  Manner plain;
  plain.is_live = false;
  const LiveRun first = run(scene, plain);
  Manner how;
  how.replay = first.rows;
  how.after_tick = at({{100, TelemetryCommand::kPause},
                       {700, TelemetryCommand::kZero},
                       {800, TelemetryCommand::kEmergencyStop}});
  how.meanwhile = [](Console& console) {
    while (!console.has(TelemetryEventKind::kPaused))
      std::this_thread::sleep_for(milliseconds(1));
    console.give(TelemetryCommand::kResume);
  };
  const LiveRun again = run(scene, how);
  EXPECT_EQ(again.report.replay_first_difference, -1);
  EXPECT_EQ(again.recording, first.recording);
  EXPECT_EQ(count(again.events, TelemetryEventKind::kResumed), 1U);
}

TEST(TelemetrySession, ShowsWhatTheSessionReportsAndChangesNothing) {
  Scene scene = test::descent_scene({0.12, 0.11, 0.1}, 0.13, 0.085, 0.05);
  scene.tissue.threshold_N = 10;
  for (const ForceLawKind law : {ForceLawKind::kHooke, ForceLawKind::kNetwork}) {
    scene.force_law.kind = law;
    Manner plain;
    plain.is_live = false;
    const LiveRun without = run(scene, plain);
    Manner how;
    std::uint64_t shapes = 0, sheet_cuts = 0;
    how.after_tick = [&](std::uint64_t tick, Console& console) {
      if (tick < 2) return;
      // The snapshot is that of the tick before.
      EXPECT_EQ(console.value("ticks"), static_cast<double>(tick - 1));
      EXPECT_EQ(console.value("t_s"), static_cast<double>(tick - 2) / 1000);
      const RecordingRow& row = without.rows[tick - 2];
      for (std::size_t i = 0; i < 8; ++i)
        EXPECT_EQ(console.value("tau_Nm", i), row.tau_Nm.at(i));
      EXPECT_EQ(console.value("fault"), 0);
      EXPECT_EQ(console.value("cuts_published"), static_cast<double>(row.cuts_published));
      EXPECT_NEAR(console.value("axis", 2), -1, 0.1);
      EXPECT_GT(console.value("joint_margin"), 0);
      EXPECT_GE(console.value("tau_limit_Nm", 3), std::abs(row.tau_Nm[3]));
      shapes = console.reader().shape_version();
      sheet_cuts = static_cast<std::uint64_t>(console.value("sheet_cuts", 2));
    };
    const LiveRun with = run(scene, how);
    EXPECT_EQ(with.recording, without.recording);
    ASSERT_EQ(with.report.punctures.size(), 3U);
    EXPECT_EQ(sheet_cuts, 1U);
    EXPECT_EQ(shapes > 0, law == ForceLawKind::kNetwork);
    std::size_t k = 0;
    for (const TelemetryEvent& event : with.events) {
      if (event.kind != TelemetryEventKind::kPuncture) continue;
      const PunctureEvent& wanted = with.report.punctures[k++];
      EXPECT_EQ(event.sheet, wanted.sheet);
      EXPECT_EQ(event.slice, wanted.slice);
      EXPECT_EQ(event.cut, wanted.cut);
      EXPECT_EQ(event.t_s, wanted.t_s);
      EXPECT_EQ(event.tool_z_m, wanted.tool_z_m);
      EXPECT_EQ(event.penetration_m, wanted.penetration_m);
      EXPECT_EQ(event.force_N, wanted.force_N);
      EXPECT_EQ(event.hand_N, wanted.hand_N);
      EXPECT_EQ(event.trial_force_N, wanted.trial_force_N);
    }
    EXPECT_EQ(k, 3U);
    EXPECT_EQ(count(with.events, TelemetryEventKind::kCutShown), 3U);
  }
}

TEST(TelemetrySession, HuOfVerticesThatACutMadeAreInterpolated) {
  const test::TemporaryFolder folder;
  Scene scene = test::descent_scene({0.12}, 0.13, 0.1, 0.05);
  scene.tissue.threshold_N = 10;
  Asset asset = test::square_asset(1);
  // Linear in x and y of {B}, whose origin is at (80, 60) mm of the plane.
  const auto hu_at = [](double x_mm, double y_mm) { return 300 + 7 * x_mm - 4 * y_mm; };
  AssetSlice& slice = asset.slices[0];
  for (const LatticePoint& p : slice.mesh.vertices)
    slice.hu.push_back(static_cast<float>(hu_at(p.x / 256.0 - 80, p.y / 256.0 - 60)));
  Remesher remesher(*place_slices(scene, asset, "a"));
  auto device = make_simulated_device(scene, default_device_description());
  ASSERT_TRUE(device);
  SessionOptions options;
  options.clock = Clock::kVirtual;
  options.duration_s = scene.duration_s;
  options.limits.gap_max_s = 0;
  options.telemetry = TelemetryOptions{folder / "live", "", "", "", {}};
  auto workers = test::make_workers(scene, remesher, options);
  ASSERT_TRUE(workers);
  Console console(options.telemetry->file);
  TelemetrySheet first;
  ASSERT_TRUE(console.reader().sheet(0, first));
  run_session(
      scene, default_device_description(), remesher, *device,
      [&](double dt_s) { device->step(dt_s); }, options, std::move(*workers));
  TelemetrySheet sheet;
  ASSERT_TRUE(console.reader().sheet(0, sheet));
  EXPECT_EQ(sheet.cuts, 1U);
  ASSERT_EQ(sheet.hu.size(), sheet.xy_m.size() / 2);
  EXPECT_NE(sheet.hu.size(), first.hu.size());
  for (std::size_t v = 0; v < sheet.hu.size(); ++v) {
    const double x_mm = 1e3 * static_cast<double>(sheet.xy_m[2 * v]);
    const double y_mm = 1e3 * static_cast<double>(sheet.xy_m[2 * v + 1]);
    EXPECT_NEAR(sheet.hu[v], hu_at(x_mm, y_mm), 1e-3) << x_mm << ", " << y_mm;
  }
}

TEST(TelemetrySession, TheHapticThreadTakesNoLockAndAllocatesNothing) {
  TROCAR_NEEDS_COUNTED_ALLOCATIONS();
  Scene scene = test::descent_scene({0.12, 0.11, 0.1}, 0.13, 0.085, 0.05);
  scene.force_law.kind = ForceLawKind::kNetwork;
  for (const Clock clock : {Clock::kVirtual, Clock::kReal}) {
    const std::uint64_t locks_before = locks_in_scopes();
    Manner how;
    how.clock = clock;
    // The commands are given by another process; here by another thread.
    how.meanwhile = [](Console& console) {
      while (!console.has(TelemetryEventKind::kPuncture))
        std::this_thread::sleep_for(milliseconds(1));
      console.give(TelemetryCommand::kPause);
      while (!console.has(TelemetryEventKind::kPaused))
        std::this_thread::sleep_for(milliseconds(1));
      console.give(TelemetryCommand::kResume);
    };
    if (clock == Clock::kVirtual) how.meanwhile = {};
    const LiveRun finished = run(scene, how);
    EXPECT_EQ(finished.report.allocations_in_loop, 0U);
    EXPECT_EQ(locks_in_scopes() - locks_before, 0U);
  }
}

TEST(TelemetryHistogram, BinsAreQuartersOfAnOctave) {
  EXPECT_EQ(TelemetryHistogram::lower_us(0), 0);
  EXPECT_EQ(TelemetryHistogram::bin(-5), 0U);
  EXPECT_EQ(TelemetryHistogram::bin(0), 0U);
  EXPECT_EQ(TelemetryHistogram::bin(std::int64_t{1} << 40), TelemetryHistogram::kBins - 1);
  for (std::size_t i = 1; i < TelemetryHistogram::kBins; ++i) {
    const std::int64_t lower_ns = std::llround(TelemetryHistogram::lower_us(i) * 1e3);
    EXPECT_EQ(TelemetryHistogram::bin(lower_ns), i);
    EXPECT_EQ(TelemetryHistogram::bin(lower_ns - 1), i - 1);
  }
}

}  // namespace
}  // namespace trocar::runtime
