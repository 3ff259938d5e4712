// SPDX-License-Identifier: Apache-2.0
#include "runtime/console/session_telemetry.h"

#include <gtest/gtest.h>

#include <cmath>

namespace trocar::runtime {
namespace {

TEST(ForceHistory, KeepsEveryPointWhileThereAreFew) {
  ForceHistory history;
  for (int i = 0; i < 100; ++i)
    history.add({0.004 * i, 1.0 * i, -1e-3 * i});
  ASSERT_EQ(history.points().size(), 100U);
  EXPECT_EQ(history.points()[37].force_N, 37);
  EXPECT_EQ(history.points()[37].tip_z_m, -0.037);
  history.add({0.1, 999, 0});
  history.add({std::nan(""), 999, 0});
  EXPECT_EQ(history.points().size(), 100U) << "time goes forward";
  history.clear();
  EXPECT_TRUE(history.points().empty());
  history.add({0, 1, 0});
  EXPECT_EQ(history.points().size(), 1U);
}

// An hour at 250 snapshots a second, with short peaks.
TEST(ForceHistory, AnHourIsSmallAndKeepsItsPeaks) {
  ForceHistory history;
  constexpr int kSnapshots = 900'000, kEvery = 45'000;
  for (int i = 0; i < kSnapshots; ++i) {
    const int peak = i / kEvery;
    history.add({0.004 * i, i % kEvery == kEvery / 2 ? 50.0 + peak : 1.0, 0});
  }
  EXPECT_LE(history.points().size(), ForceHistory::kMaxPoints);
  EXPECT_GT(history.points().size(), ForceHistory::kMaxPoints / 4);
  int peaks = 0;
  double last_t_s = -1;
  for (const ForceHistory::Point& point : history.points()) {
    EXPECT_GT(point.t_s, last_t_s);
    last_t_s = point.t_s;
    if (point.force_N == 1) continue;
    EXPECT_EQ(point.force_N, 50 + peaks);
    ++peaks;
  }
  EXPECT_EQ(peaks, kSnapshots / kEvery);
}

// Points are removed when there is one more than kMaxPoints, so the newest one has no partner.
TEST(ForceHistory, APeakThatFillsTheHistoryStays) {
  ForceHistory history;
  constexpr auto kMost = static_cast<int>(ForceHistory::kMaxPoints);
  for (int i = 0; i <= kMost; ++i)
    history.add({0.004 * i, i == kMost ? 50.0 : 1.0, 0});
  ASSERT_FALSE(history.points().empty());
  EXPECT_EQ(history.points().back().force_N, 50);
}

}  // namespace
}  // namespace trocar::runtime
