// SPDX-License-Identifier: Apache-2.0
// Sessions that are shown in memory and take commands: zero, recover, emergency stop and stop; the
// same recording with and without; no allocation and no lock on the haptic thread.
// paused_session_test.cpp has the pauses.
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <thread>

#include "runtime/realtime/realtime_thread.h"
#include "tests/reference/hooks/lock_counter.h"
#include "tests/runtime/session/live_run.h"
#include "tests/support/counted_allocations.h"

namespace trocar::runtime {
namespace {

using namespace testing_support;
using std::chrono::milliseconds;

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
    EXPECT_EQ(count(with.events, TelemetryEventKind::kPuncture), 3U);
    EXPECT_EQ(count(with.events, TelemetryEventKind::kCutShown), 3U);
  }
}

TEST(TelemetrySession, HuOfVerticesThatACutMadeAreInterpolated) {
  Scene scene = test::descent_scene({0.12}, 0.13, 0.1, 0.05);
  scene.tissue.threshold_N = 10;
  Asset asset = test::square_asset(1);
  // Linear in x and y of {B}, whose origin is at (80, 60) mm of the plane.
  const auto hu_at = [](double x_mm, double y_mm) { return 300 + 7 * x_mm - 4 * y_mm; };
  AssetSlice& slice = asset.slices[0];
  for (const LatticePoint& p : slice.mesh.vertices)
    slice.hu.push_back(static_cast<float>(hu_at(p.x / 256.0 - 80, p.y / 256.0 - 60)));
  TestSession session(scene, std::move(asset));
  session.options.telemetry = TelemetryOptions{session.folder / "live", "", "", "", {}};
  session.prepare();
  Console console(session.options.telemetry->file);
  TelemetrySheet first;
  ASSERT_TRUE(console.reader().sheet(0, first));
  session.run();
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
