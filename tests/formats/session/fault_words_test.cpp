// SPDX-License-Identifier: Apache-2.0
// The words for faults: complete, distinct, on one line, with the value told from its limit. That
// no fault lacks words is checked when fault_words.cpp is compiled.
#include "formats/session/faults.h"

#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <iterator>
#include <limits>
#include <set>
#include <string>

namespace trocar {
namespace {

using enum FaultQuantity;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

TEST(FaultWords, EveryFaultHasItsOwnWordsOnOneLine) {
  std::set<std::string> names, meanings, stills;
  for (int i = 0; i < kFaults; ++i) {
    const auto fault = static_cast<Fault>(i);
    const FaultWords& words = words_of(fault);
    EXPECT_STREQ(words.name, to_string(fault));
    names.insert(words.name);
    meanings.insert(words.meaning);
    stills.insert(words.meaning_in_recovery);
    const std::string line = describe(fault, 1);
    EXPECT_EQ(line,
              std::string(words.name) + " at 1.0000 s: " + words.meaning + "; " + words.advice);
    for (const char c : line)
      EXPECT_TRUE(c >= ' ' && c <= '~') << line;
  }
  EXPECT_EQ(names.size(), static_cast<std::size_t>(kFaults));
  EXPECT_EQ(meanings.size(), static_cast<std::size_t>(kFaults));
  EXPECT_EQ(stills.size(), static_cast<std::size_t>(kFaults));
}

TEST(FaultWords, TheManualHasEachFaultWithItsCauses) {
  std::ifstream file(TROCAR_OPERATORS_PAGE);
  const std::string page{std::istreambuf_iterator<char>(file), {}};
  ASSERT_FALSE(page.empty());
  for (int i = 1; i < kFaults; ++i) {
    const FaultWords& words = words_of(static_cast<Fault>(i));
    const std::string row = std::string("| `") + words.name + "` | " + words.cause + " |\n";
    EXPECT_NE(page.find(row), std::string::npos) << row;
  }
}

TEST(FaultWords, TheLineNamesSensorValueLimitAndWhatToDo) {
  EXPECT_EQ(describe({Fault::kWorkspace, kPlatePosition, 2, 0.2413, 0.24}, 1.25),
            "workspace at 1.2500 s: the plate is outside its box, or tilted too far "
            "(plate z 241.3 mm, limit 240 mm); move the tool back towards the middle");
  EXPECT_EQ(measured({Fault::kWorkspace, kPlatePosition, 0, -0.0613, -0.06}),
            "plate x -61.3 mm, at least -60 mm");
  EXPECT_EQ(measured({Fault::kEncoderJump, kEncoderStep, 6, 0.3, 0.06}),
            "step of encoder theta 3 of leg 2 17.19 deg, limit 3.438 deg");
  EXPECT_EQ(measured({Fault::kEncoderNotFinite, kEncoderAngle, 15, kNan, kNan}),
            "angle theta 4 of leg 4 nan deg");
  EXPECT_EQ(measured({Fault::kMotorOverload, kMotorHeat, 5, 1.002, 1}),
            "thermal state of motor theta 4 of leg 3 100.2 %, limit 100 %");
  EXPECT_EQ(measured({Fault::kMotorFault, kMotor, 0, 0, 0}), "motor theta 1 of leg 1");
  EXPECT_EQ(measured({Fault::kDeadlineMissed, kMissedDeadlines, -1, 3, 2}),
            "deadlines missed in a row: 3, limit 2");
  EXPECT_EQ(measured({Fault::kMotorFault, kFaultByte, -1, 4, kNan}), "fault byte of the device: 4");
  EXPECT_EQ(describe({Fault::kRefusedState, kMeasuredPosition, 0, kNan, 10}, 2),
            "refused_state at 2.0000 s: the device's states arrive, but are refused because of "
            "their contents (measured position x nan mm, limit 1e+04 mm); correct what the "
            "device's program states: metres, radians, finite numbers, a unit quaternion");
  EXPECT_EQ(measured({Fault::kRefusedState, kRefusedContents, -1, 0, 0}),
            "a message that cannot be read");
  EXPECT_EQ(measured(Fault::kEmergencyStop), "");
}

TEST(FaultWords, AValueJustBeyondItsLimitIsToldFromIt) {
  EXPECT_EQ(measured({Fault::kWorkspace, kPlatePosition, 2, 0.240000012, 0.24}),
            "plate z 240.00001 mm, limit 240 mm");
  const double next = std::nextafter(2.0, 3.0);
  const std::string text = measured({Fault::kSpeed, kPlateSpeed, -1, next, 2});
  EXPECT_EQ(text.find("plate speed 2 m/s"), std::string::npos) << text;
}

TEST(FaultWords, QuantitiesAreNamedAsColumnsWithTheirUnit) {
  EXPECT_EQ(quantity_name({Fault::kEncoderJump, kEncoderStep, 6, 0, 0}), "th_2_3_step_rad");
  EXPECT_EQ(quantity_name({Fault::kTorqueLimit, kMotorTorque, 7, 0, 0}), "tau_4_4_Nm");
  EXPECT_EQ(quantity_name({Fault::kWorkspace, kPlatePosition, 1, 0, 0}), "y_m");
  EXPECT_EQ(quantity_name({Fault::kTorqueNotFinite, kWantedWrench, 2, 0, 0}), "fz_wanted_N");
  EXPECT_EQ(quantity_name({Fault::kTorqueNotFinite, kWantedWrench, 5, 0, 0}), "tz_wanted_Nm");
  EXPECT_EQ(quantity_name({Fault::kSingularity, kBranchDistance, 3, 0, 0}), "branch_distance_4_m");
  EXPECT_EQ(quantity_name(Fault::kLinkLost), "");
  std::set<std::string> names;
  for (int i = 0; i < kFaultQuantities; ++i) {
    const FaultDetail detail(Fault::kSpeed, static_cast<FaultQuantity>(i), 0, 2, 1);
    names.insert(quantity_name(detail));
    EXPECT_EQ(measured(detail).find('#'), std::string::npos);
    EXPECT_EQ(quantity_name(detail).find_first_of("# "), std::string::npos);
  }
  EXPECT_EQ(names.size(), static_cast<std::size_t>(kFaultQuantities));
}

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
