// SPDX-License-Identifier: Apache-2.0
// Missed deadlines are attributed to the part of the period that took the time, none twice and none to nothing.
#include "runtime/realtime/realtime_thread.h"

#include <gtest/gtest.h>

#include <numeric>

namespace trocar::runtime {
namespace {

constexpr double kPeriod_ns = 1e6;

TickTiming timing(std::uint64_t missed, double late_periods) {
  TickTiming timing;
  timing.missed_deadlines = missed;
  timing.late_ns = static_cast<std::int64_t>(late_periods * kPeriod_ns);
  return timing;
}

TEST(LateTicks, AreThoseOfTheLongestPartOfTheTickBefore) {
  for (const TickPart part : {TickPart::kDevice, TickPart::kLaw, TickPart::kPublishing}) {
    LateTicks late;
    late.begin(timing(0, 0.02), kPeriod_ns);
    for (const TickPart each : {TickPart::kDevice, TickPart::kLaw, TickPart::kPublishing})
      late.spend(each, each == part ? 3'200'000 : 40'000);
    late.begin(timing(3, 0.02), kPeriod_ns);
    LateTicks::Counts wanted{};
    wanted[static_cast<std::size_t>(part)] = 3;
    EXPECT_EQ(late.counts(), wanted);
    // The time of an earlier tick does not count again.
    late.spend(TickPart::kDevice, 50'000);
    late.begin(timing(3, 0.9), kPeriod_ns);
    EXPECT_EQ(late.counts(), wanted);
  }
}

TEST(LateTicks, AreThoseOfWakingIfTheyPassedWhileTheThreadSlept) {
  LateTicks late;
  late.begin(timing(0, 0.02), kPeriod_ns);
  late.spend(TickPart::kLaw, 2'100'000);     // two deadlines are missed,
  late.begin(timing(32, 30.4), kPeriod_ns);  // and then the machine stalls for 30 periods
  EXPECT_EQ(late.counts(), (LateTicks::Counts{30, 0, 2, 0}));
  EXPECT_EQ(std::accumulate(late.counts().begin(), late.counts().end(), std::uint64_t{0}), 32U);
}

TEST(LateTicks, BeforeTheFirstTickAreThoseOfWaking) {
  LateTicks late;
  late.begin(timing(5, 5.5), kPeriod_ns);
  EXPECT_EQ(late.counts(), (LateTicks::Counts{5, 0, 0, 0}));
}

}  // namespace
}  // namespace trocar::runtime
