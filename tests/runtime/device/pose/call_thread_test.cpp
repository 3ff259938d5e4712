// SPDX-License-Identifier: Apache-2.0
#include "runtime/device/pose/connected_device.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <memory>
#include <optional>
#include <string>
#include <thread>

namespace trocar::runtime {
namespace {

constexpr double kLong_s = 30;  // no test waits for so long
constexpr double kShort_s = 0.02;

/// A call that hangs until it is released. Its copies share the state.
struct Hanging {
  std::shared_ptr<std::atomic<bool>> released = std::make_shared<std::atomic<bool>>(false);
  std::shared_ptr<std::atomic<int>> returned = std::make_shared<std::atomic<int>>(0);
  int operator()() const {
    while (!*released)
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    return ++*returned;
  }
};

TEST(CallThread, ReturnsTheResultsOfOneThread) {
  CallThread calls;
  const auto first = calls.call([] { return std::this_thread::get_id(); }, kLong_s);
  const auto second = calls.call([] { return std::this_thread::get_id(); }, kLong_s);
  ASSERT_TRUE(first && second);
  EXPECT_EQ(*first, *second);
  EXPECT_NE(*first, std::this_thread::get_id());
  EXPECT_EQ(calls.call([] { return std::string("text"); }, kLong_s), "text");
}

TEST(CallThread, GivesUpOnACallThatHangs) {
  CallThread calls;
  const Hanging hanging;
  EXPECT_EQ(calls.call(hanging, kShort_s), std::nullopt);
  EXPECT_EQ(*hanging.returned, 0);
  std::atomic<bool> begun = false;
  EXPECT_EQ(calls.call([&] { return begun = true; }, kShort_s), std::nullopt);
  *hanging.released = true;
  EXPECT_EQ(calls.call([] { return 5; }, kLong_s), 5);
  EXPECT_EQ(*hanging.returned, 1);
  EXPECT_FALSE(begun);  // a call that was given up before it began is never made
}

TEST(CallThread, LastCallFollowsTheOneThatHangs) {
  CallThread calls;
  const Hanging hanging;
  EXPECT_EQ(calls.call(hanging, kShort_s), std::nullopt);
  int replaced = 0;
  int after = -1;
  calls.call_at_last([&] { ++replaced; });
  calls.call_at_last([&, hanging] { after = *hanging.returned; });
  EXPECT_EQ(after, -1);
  *hanging.released = true;
  EXPECT_EQ(calls.call([&] { return after; }, kLong_s), 1);
  EXPECT_EQ(replaced, 0);
  calls.call_at_last([&] { after = 7; });  // waits for it, as nothing hangs
  EXPECT_EQ(calls.call([&] { return after; }, kLong_s), 7);
}

TEST(CallThread, CanBeDestroyedWhileACallHangs) {
  const Hanging hanging;
  const auto last = std::make_shared<std::atomic<bool>>(false);
  {
    CallThread calls;
    EXPECT_EQ(calls.call(hanging, kShort_s), std::nullopt);
    calls.call_at_last([last] { *last = true; });
  }
  *hanging.released = true;
  for (int i = 0; i < 10'000 && !*last; ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  EXPECT_TRUE(*last);  // also the last call is still made
}

}  // namespace
}  // namespace trocar::runtime
