// SPDX-License-Identifier: Apache-2.0
#include "runtime/session/xray_commands.h"

#include <gtest/gtest.h>

namespace trocar::runtime {
namespace {

constexpr std::int64_t kTick_ns = 1'000'000;

TelemetryCommands given(bool shot, std::uint64_t screening) {
  TelemetryCommands commands;
  commands.xray_shot = shot;
  commands.screening = screening;
  return commands;
}

TEST(XrayCommands, ShotIsTakenInOneTick) {
  XrayCommands xray;
  xray.apply(given(true, 0), kTick_ns);
  EXPECT_EQ(xray.take(), kXrayPicture);
  xray.apply(given(false, 0), 2 * kTick_ns);
  EXPECT_EQ(xray.take(), 0);
}

TEST(XrayCommands, ScreeningLastsWhileItIsHeld) {
  XrayCommands xray;
  xray.apply(given(false, 3), kTick_ns);
  EXPECT_EQ(xray.take(), kXrayBeam);
  xray.apply(given(true, 5), 2 * kTick_ns);
  EXPECT_EQ(xray.take(), kXrayBeam | kXrayPicture);
  xray.apply(given(false, 6), 3 * kTick_ns);
  EXPECT_EQ(xray.take(), 0);
}

TEST(XrayCommands, ScreeningEndsIfNobodyConfirmsIt) {
  XrayCommands xray;
  xray.apply(given(false, 1), 0);
  xray.apply(given(false, 1), XrayCommands::kHeld_ns - 1);
  EXPECT_EQ(xray.take(), kXrayBeam);
  xray.apply(given(false, 1), XrayCommands::kHeld_ns);
  EXPECT_EQ(xray.take(), 0);
  xray.apply(given(false, 3), XrayCommands::kHeld_ns + kTick_ns);  // confirmed late: it goes on
  EXPECT_EQ(xray.take(), kXrayBeam);
}

TEST(XrayCommands, NothingIsOnBeforeTheFirstCommand) {
  XrayCommands xray;
  xray.apply(given(false, 0), 0);
  EXPECT_EQ(xray.take(), 0);
}

}  // namespace
}  // namespace trocar::runtime
