// SPDX-License-Identifier: Apache-2.0
// Which stops are held, and in which rows faults begin.
#include "formats/session/faults.h"

#include <gtest/gtest.h>

namespace trocar {
namespace {

using S = DeviceStatus;

TEST(HeldStops, APressIsNewOnceForEachSource) {
  HeldStops stops;
  EXPECT_TRUE(stops.take(S::kEmergencyStop, Fault::kNone));
  EXPECT_FALSE(stops.take(S::kEmergencyStop, Fault::kPaused)) << "held; a pause is no emergency";
  EXPECT_TRUE(stops.take(S::kEmergencyStop, Fault::kEmergencyStop)) << "the operator's, too";
  EXPECT_FALSE(stops.take(S::kOk, Fault::kEmergencyStop));
  EXPECT_TRUE(stops.any());
  EXPECT_TRUE(stops.refuse_recovery()) << "the device's was released just now";
  EXPECT_FALSE(stops.take(S::kOk, Fault::kNone));
  EXPECT_FALSE(stops.any());
  EXPECT_FALSE(stops.refuse_recovery()) << "the operator's request releases the operator's stop";
  EXPECT_TRUE(stops.take(S::kEmergencyStop, Fault::kNone));
}

TEST(HeldStops, AWriteCanTellAStopUntilALaterWriteDoesNot) {
  HeldStops stops;
  EXPECT_FALSE(stops.take(S::kOk, Fault::kNone));
  EXPECT_TRUE(stops.take_write(S::kEmergencyStop));
  for (int i = 0; i < 3; ++i) {
    EXPECT_FALSE(stops.take(S::kOk, Fault::kNone));
    EXPECT_TRUE(stops.is_device_held());
    EXPECT_FALSE(stops.take_write(S::kEmergencyStop)) << "held";
  }
  EXPECT_FALSE(stops.take_write(S::kOk));
  EXPECT_TRUE(stops.is_device_held()) << "only a read tells a release";
  EXPECT_FALSE(stops.take(S::kNoData, Fault::kNone));
  EXPECT_TRUE(stops.is_device_held());
  EXPECT_FALSE(stops.take(S::kMotorFault, Fault::kNone));
  EXPECT_FALSE(stops.is_device_held());
}

TEST(HeldStops, OnlyTheOperatorsAndTheDevicesCommandsAreStops) {
  for (int f = 0; f < kFaults; ++f) {
    const auto fault = static_cast<Fault>(f);
    HeldStops stops;
    stops.take(S::kOk, fault);
    EXPECT_EQ(stops.any(), fault == Fault::kEmergencyStop || fault == Fault::kPaused ||
                               fault == Fault::kForcesOff);
  }
}

}  // namespace
}  // namespace trocar
