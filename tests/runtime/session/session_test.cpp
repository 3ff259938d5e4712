// SPDX-License-Identifier: Apache-2.0
// How sessions begin and end, their number of ticks, and the rate of a recording.
#include "runtime/session/session.h"
#include "runtime/session/origin.h"
#include "runtime/session/session_options.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <fstream>
#include <string>
#include <thread>
#include <vector>

#include "tests/runtime/haptics/loop/loop_fixture.h"
#include "tests/runtime/session/test_session.h"
#include "tests/support/file_size_limit.h"

namespace trocar::runtime {
namespace {

using testing_support::largest;
using testing_support::TestSession;

/// A simulated device that tells whether torques are on its motors.
class WatchedDevice final : public Device {
 public:
  explicit WatchedDevice(SimulatedDevice& device) : device_(device) {}
  DeviceStatus read(DeviceState& state) noexcept override { return device_.read(state); }
  DeviceStatus write(const DeviceCommand& command) noexcept override {
    const DeviceStatus status = device_.write(command);
    is_loaded = largest(command) > 0;
    return status;
  }
  std::atomic<bool> is_loaded{false};

 private:
  SimulatedDevice& device_;
};

TEST(Session, TorquesAreZeroBeforeOtherThreadsEnd) {
  TestSession session(test::descent_scene({0.12}, 0.121, 0.1, 0.05));
  session.simulate();
  WatchedDevice device(*session.device);
  std::atomic<bool> stop{false}, loaded{false}, released{false};
  SessionOptions& options = session.options;
  options.clock = Clock::kReal;
  options.record.reset();
  options.duration_s = 2;
  options.stop = &stop;
  // A display that is busy when the session ends: until torques are zero, at most 5 s.
  options.on_frame = [&](const RecordingRow&, const auto&) {
    const auto start = std::chrono::steady_clock::now();
    while (!released && std::chrono::steady_clock::now() - start < std::chrono::seconds(5)) {
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
      released = stop && !device.is_loaded;
    }
  };
  options.frame_rate_Hz = 1000;
  const SessionResult report = session.run(device, [&](double dt_s) {
    session.device->step(dt_s);
    if (!device.is_loaded || session.device->truth().tau_motor_Nm.norm() < 0.5) return;
    loaded = true;
    stop = true;
  });
  ASSERT_TRUE(loaded) << "the tool was never pressed into the sheet";
  EXPECT_EQ(report.end, SessionEnd::kInterrupted);
  EXPECT_TRUE(released) << "torques stayed on while the session waited for the display";
}

// Sheet, shaft and rim, damping by the controller, through the coupling or not: all of it.
TEST(Session, TheLargestForceIsOfAllThatActsOnTheHand) {
  for (const bool couples : {false, true}) {
    Scene scene = test::descent_scene({0.12}, 0.13, 0.105, 0.05);
    scene.tissue.threshold_N = 5;
    scene.tissue.shaft.dry_friction_N = 10;
    scene.tissue.shaft.viscous_friction_N_s_per_m = 50;
    TestSession session(scene);
    session.options.duration_s = 0.6;
    session.options.coupling.on = couples;
    const SessionResult report = session.run();
    EXPECT_EQ(report.fault, Fault::kNone) << to_string(report.fault);
    ASSERT_FALSE(report.punctures.empty());
    double largest_N = 0;
    for (const RecordingRow& row : session.rows()) {
      largest_N = std::max(largest_N, Eigen::Vector3d(row.wrench_delivered.data()).norm());
    }
    if (!couples) {
      EXPECT_GT(largest_N, 10) << "friction exceeds the sheet's 5 N";
    }
    EXPECT_NEAR(report.max_force_N, largest_N, 1e-12 * largest_N) << couples;
  }
}

/// The force on the hand in each tick.
class Forces final : public TickObserver {
 public:
  Forces() {
    N.reserve(kMost);
    faults.reserve(kMost);
  }
  void on_tick(const TickView& tick) noexcept override {
    N.push_back(Eigen::Vector3d(tick.result.row.wrench_delivered.data()).norm());
    faults.push_back(tick.result.row.fault);
  }
  std::vector<double> N;
  std::vector<Fault> faults;

 private:
  static constexpr std::size_t kMost = 20'000;
};

TEST(Session, OneThatCannotBeRecordedEndsAsByAnOperatorsStopAfterARampOfTheForces) {
  for (const RecoveryPolicy recovery :
       {RecoveryPolicy::kNever, RecoveryPolicy::kOnRequest, RecoveryPolicy::kAuto}) {
    Scene scene = test::descent_scene({0.12}, 0.13, 0.11, 0.05);
    scene.tissue.threshold_N = 1000;
    TestSession session(scene);
    Forces observed;
    session.options.duration_s = 15;
    session.options.black_box = session.folder.path();
    session.options.recovery = recovery;
    session.options.observers.push_back(&observed);
    const SessionResult report = [&] {
      const test::FileSizeLimit limit(280'000);  // reached while the tool presses on the sheet
      return session.run();
    }();
    const std::vector<double>& forces = observed.N;
    EXPECT_EQ(report.end, SessionEnd::kInterrupted);
    EXPECT_EQ(report.fault, Fault::kRecordingFailed);
    ASSERT_EQ(report.faults.size(), 1U);
    EXPECT_TRUE(report.black_boxes.empty()) << "it is no failure of the device";
    // The last force falls to zero in equal steps, within the time of the ramp.
    const auto failed =
        std::find(observed.faults.begin(), observed.faults.end(), Fault::kRecordingFailed);
    const auto first = static_cast<std::size_t>(failed - observed.faults.begin());
    EXPECT_NEAR(report.fault_t_s, static_cast<double>(first) * 1e-3, 1e-9);
    ASSERT_LE(first + 4, forces.size());
    EXPECT_LE(forces.size(), first + 5);
    const double before_N = forces[first - 1];
    EXPECT_GT(before_N, 1);
    for (std::size_t i = first; i < forces.size(); ++i) {
      EXPECT_LT(forces[i], forces[i - 1] + 1e-9) << i - first;
      EXPECT_LT(forces[i - 1] - forces[i], 0.3 * before_N) << i - first;
    }
    EXPECT_EQ(forces.back(), 0);
    // What was written can be read, and the message says where it is.
    ASSERT_TRUE(report.recording_error);
    EXPECT_EQ(report.recording_error->code, ExitCode::kUnwritable);
    const auto kept = read_recording(session.folder / "r.csv.partial");
    ASSERT_TRUE(kept) << kept.error().message;
    EXPECT_EQ(report.recording_error->message, (session.folder / "r.csv").string() +
                                                   ": File too large; the first " +
                                                   std::to_string(kept->size()) + " rows are in " +
                                                   (session.folder / "r.csv.partial").string());
    EXPECT_GT(kept->size() + 100, forces.size());
  }
}

TEST(Session, NumberOfTicks) {
  EXPECT_EQ(tick_count(1, 1000), 1000U);
  EXPECT_EQ(tick_count(3.6, 500), 1800U);
  EXPECT_EQ(tick_count(0.1 + 0.2, 1000), 300U);
  EXPECT_EQ(tick_count(0.0005, 1000), 1U);
  EXPECT_EQ(tick_count(0.0015, 1000), 2U);
}

TEST(Session, TheRateOfARecordingFollowsFromItsTimes) {
  std::vector<RecordingRow> rows(1000);
  for (std::size_t k = 0; k < rows.size(); ++k)
    rows[k].t_s = static_cast<double>(k) / 500;
  ASSERT_TRUE(recorded_rate_Hz(rows, "r"));
  EXPECT_EQ(*recorded_rate_Hz(rows, "r"), 500);
  EXPECT_EQ(*recorded_rate_Hz(rows, "r", 500), 500);
  EXPECT_EQ(*recorded_rate_Hz(rows, "r", 499), 500) << "a stated rate that is not the rows'";
  const auto later = recorded_rate_Hz(std::span(rows).subspan(10), "r");
  ASSERT_FALSE(later);
  EXPECT_NE(later.error().message.find("does not begin at the start"), std::string::npos);
  rows[500].t_s += 1e-4;
  EXPECT_FALSE(recorded_rate_Hz(rows, "r"));
  EXPECT_FALSE(recorded_rate_Hz(std::span(rows).first(1), "r"));
}

TEST(Session, TheRateOfARecordingIsExact) {
  for (const double rate_Hz : {209.3, 211.8, 212.3, 1000.0000001, 999.9999999, 333.33333333333331,
                               100.0, 123.456789012345, 8000.0, 997.3}) {
    for (const std::size_t size : {std::size_t{2}, std::size_t{3}, std::size_t{6280}}) {
      std::vector<RecordingRow> rows(size);
      for (std::size_t k = 0; k < size; ++k)
        rows[k].t_s = static_cast<double>(k) / rate_Hz;
      const Result<double> found = recorded_rate_Hz(rows, "r");
      ASSERT_TRUE(found) << found.error().message;
      EXPECT_EQ(size > 3 ? *found : rate_Hz, rate_Hz);
      EXPECT_EQ(*recorded_rate_Hz(rows, "r", rate_Hz), rate_Hz);
      for (std::size_t k = 0; k < size; ++k)
        ASSERT_EQ(static_cast<double>(k) / *found, rows[k].t_s) << rate_Hz << ", row " << k;
    }
  }
  std::vector<RecordingRow> rows(1000);  // times rounded to four digits match no rate
  for (std::size_t k = 0; k < rows.size(); ++k)
    rows[k].t_s = std::round(1e4 * static_cast<double>(k) / 209.3) / 1e4;
  const Result<double> none = recorded_rate_Hz(rows, "r");
  ASSERT_FALSE(none);
  EXPECT_EQ(none.error().code, ExitCode::kRefused);
}

// The origin that a recording names, and what a replay takes from it. tests/e2e/sessions_e2e_test.py has the refusals.

TEST(Origin, AReplayTakesNoOptionThatTheRecordingDoesNotState) {
  const RecordingOrigin recorded{{{"program", TROCAR_VERSION}, {"scene", "1"}}};
  RecordingOrigin run = recorded;
  run.entries.emplace_back("stiffness-limit", "2000");
  const auto replay = check_replay(recorded, run, "r.csv");
  ASSERT_FALSE(replay);
  EXPECT_NE(replay.error().message.find("stiffness-limit (not stated, here 2000)"),
            std::string::npos);
}

TEST(Origin, TheDurationIsTheStatedOneOrTheScenes) {
  Scene scene;
  scene.duration_s = 5;
  const auto stated = [&](const char* text) {
    return stated_duration_s({{{"duration_s", text}}}, scene);
  };
  EXPECT_EQ(stated_duration_s({}, scene), 5);
  EXPECT_EQ(stated("2.5"), 2.5);
  for (const char* const bad : {"nan", "-1", "0", "1e9", "inf", "x"})
    EXPECT_EQ(stated(bad), 5) << bad;
}

TEST(Origin, StatesALongerLimitOfTheTimeWithoutData) {
  const auto stated_by = [](const RecordingOrigin& recorded) {
    SessionOptions options;
    set_stated_limits(recorded, options);
    return options.limits.no_data_max_s;
  };
  const auto stated = [&](const char* text) { return stated_by({{{"no-data-limit", text}}}); };
  const double usual_s = SafetyLimits{}.no_data_max_s;
  EXPECT_EQ(stated_by({}), usual_s);
  EXPECT_EQ(stated("0.25"), 0.25);
  for (const char* const bad : {"nan", "-1", "0", "0.009", "1.1", "inf", "x"})
    EXPECT_EQ(stated(bad), usual_s) << bad;
}

}  // namespace
}  // namespace trocar::runtime
