// SPDX-License-Identifier: Apache-2.0
#include "runtime/session/operator_messages.h"

#include <gtest/gtest.h>

namespace trocar::runtime {
namespace {

constexpr std::int64_t kMillisecond_ns = 1'000'000;

TelemetryCommands given(std::uint64_t shots, std::uint64_t screening) {
  TelemetryCommands commands;
  commands.xray_shots = shots;
  commands.screening = screening;
  return commands;
}

TEST(XrayCommands, ShotsBetweenTwoTicksAreTakenOneAfterTheOther) {
  XrayCommands xray;
  xray.apply(given(3, 0), false, kMillisecond_ns);
  int taken = 0;
  for (int tick = 0; tick < 10; ++tick) {
    taken += xray.take();
    xray.apply(given(0, 0), false, kMillisecond_ns);
  }
  EXPECT_EQ(taken, 3 * kXrayPicture);
  // A hostile process cannot keep the loop busy.
  xray.apply(given(~std::uint64_t{0}, 0), false, kMillisecond_ns);
  for (taken = 0; xray.take() != 0;)
    ++taken;
  EXPECT_EQ(taken, static_cast<int>(XrayCommands::kMaxWaiting));
}

TEST(XrayCommands, NothingIsTakenWhileTimeStandsStill) {
  XrayCommands xray;
  xray.apply(given(2, 0), false, kMillisecond_ns);
  xray.apply(given(1, 0), true, kMillisecond_ns);
  xray.apply(given(0, 0), false, kMillisecond_ns);
  EXPECT_EQ(xray.take(), 0);
}

TEST(XrayCommands, APauseEndsScreeningUntilTheNextCommand) {
  XrayCommands xray;
  xray.apply(given(0, 1), false, 0);
  xray.apply(given(0, 3), true,
             100 * kMillisecond_ns);  // whether it was repeated in the pause or not
  xray.apply(given(0, 3), false, 300 * kMillisecond_ns);
  EXPECT_EQ(xray.take(), 0);
  xray.apply(given(0, 5), false, 400 * kMillisecond_ns);
  EXPECT_EQ(xray.take(), kXrayBeam);
}

TEST(XrayCommands, ScreeningLastsWhileItIsHeld) {
  XrayCommands xray;
  xray.apply(given(0, 3), false, kMillisecond_ns);
  EXPECT_EQ(xray.take(), kXrayBeam);
  xray.apply(given(1, 5), false, 2 * kMillisecond_ns);
  EXPECT_EQ(xray.take(), kXrayBeam | kXrayPicture);
  xray.apply(given(0, 6), false, 3 * kMillisecond_ns);
  EXPECT_EQ(xray.take(), 0);
}

TEST(XrayCommands, ScreeningEndsIfNobodyConfirmsIt) {
  XrayCommands xray;
  xray.apply(given(0, 1), false, 0);
  xray.apply(given(0, 1), false, XrayCommands::kHeld_ns - 1);
  EXPECT_EQ(xray.take(), kXrayBeam);
  xray.apply(given(0, 1), false, XrayCommands::kHeld_ns);
  EXPECT_EQ(xray.take(), 0);
  xray.apply(given(0, 3), false,
             XrayCommands::kHeld_ns + kMillisecond_ns);  // confirmed late: it goes on
  EXPECT_EQ(xray.take(), kXrayBeam);
}

}  // namespace
}  // namespace trocar::runtime
