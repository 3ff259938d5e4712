// SPDX-License-Identifier: Apache-2.0
// The contract of HandHolder.
#include <gtest/gtest.h>

#include "runtime/console/access.h"

namespace trocar::runtime {
namespace {

using std::chrono::milliseconds;

struct TwoClients {
  HandHolder hand;
  int first = 0, second = 0;
  HandHolder::Clock::time_point now = HandHolder::Clock::time_point(std::chrono::hours(1));
};

TEST(HandHolder, TheFirstHoldsUntilItLetsGo) {
  TwoClients t;
  EXPECT_EQ(t.hand.share_of(&t.first), HandShare::kFree);
  EXPECT_TRUE(t.hand.move(&t.first, 1, t.now));
  EXPECT_EQ(t.hand.share_of(&t.first), HandShare::kYours);
  EXPECT_EQ(t.hand.share_of(&t.second), HandShare::kOther);
  EXPECT_FALSE(t.hand.move(&t.second, 1, t.now + milliseconds(20)));
  EXPECT_FALSE(t.hand.let_go(&t.second));
  EXPECT_TRUE(t.hand.move(&t.first, 2, t.now + milliseconds(20)));
  EXPECT_TRUE(t.hand.let_go(&t.first));
  EXPECT_EQ(t.hand.share_of(&t.second), HandShare::kFree);
  EXPECT_TRUE(t.hand.move(&t.second, 1, t.now + milliseconds(40)));
  EXPECT_EQ(t.hand.share_of(&t.first), HandShare::kOther);
}

TEST(HandHolder, SilenceOfASecondFreesIt) {
  TwoClients t;
  EXPECT_FALSE(t.hand.lose_silent(t.now));
  t.hand.move(&t.first, 1, t.now);
  // Another client's messages, and old ones, are silence.
  for (int i = 1; i < 10; ++i) {
    t.hand.move(&t.second, static_cast<std::uint64_t>(i), t.now + milliseconds(100 * i));
    t.hand.move(&t.first, 1, t.now + milliseconds(100 * i));
  }
  EXPECT_FALSE(t.hand.lose_silent(t.now + milliseconds(999)));
  EXPECT_TRUE(t.hand.lose_silent(t.now + milliseconds(1000)));
  EXPECT_FALSE(t.hand.lose_silent(t.now + milliseconds(1000)));
  EXPECT_EQ(t.hand.share_of(&t.first), HandShare::kFree);
  EXPECT_TRUE(t.hand.move(&t.first, 1, t.now + milliseconds(1001))) << "numbers begin anew";
}

TEST(HandHolder, AFloodIsThinnedOut) {
  TwoClients t;
  std::uint64_t number = 0;
  int used = 0;
  for (int us = 0; us < 4'000'000; us += 100)  // 10,000 messages a second
    used += t.hand.move(&t.first, ++number, t.now + std::chrono::microseconds(us)) ? 1 : 0;
  EXPECT_GE(used, 495);
  EXPECT_LE(used, 505);
  EXPECT_FALSE(t.hand.lose_silent(t.now + milliseconds(4500))) << "dropped ones are no silence";
}

TEST(HandHolder, EveryFrameOfAPageIsUsed) {
  TwoClients t;
  std::uint64_t number = 0;
  for (int frame = 0; frame < 600; ++frame) {  // 60 a second, which arrive up to 12 ms late
    const int us = frame * 16'667 + frame % 4 * 4000;
    ASSERT_TRUE(t.hand.move(&t.first, ++number, t.now + std::chrono::microseconds(us))) << frame;
  }
}

}  // namespace
}  // namespace trocar::runtime
