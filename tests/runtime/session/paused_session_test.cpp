// SPDX-License-Identifier: Apache-2.0
// Sessions that the operator pauses: their time and torques meanwhile, and how they go on.
// live_session_test.cpp has the other commands.
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <functional>
#include <thread>
#include <tuple>

#include "tests/runtime/session/live_run.h"

namespace trocar::runtime {
namespace {

using namespace testing_support;
using std::chrono::milliseconds;
using std::chrono::steady_clock;

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

/// A session of 0.5 s in real time, which is paused after 450 ticks and then resumed.
/// `while_paused` is called in between, with the number of ticks.
SessionResult run_paused(
    const Scene& scene, ClockedDevice& device,
    const std::function<void(Console& console, std::uint64_t ticks)>& while_paused) {
  TestSession session(scene, 3);
  SessionOptions& options = session.options;
  options.clock = Clock::kReal;
  options.duration_s = 0.5;
  options.record.reset();
  options.telemetry = TelemetryOptions{session.folder / "live", "", "", "", {}};
  session.prepare();
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
  SessionResult report = session.run(device, advance);
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

}  // namespace
}  // namespace trocar::runtime
