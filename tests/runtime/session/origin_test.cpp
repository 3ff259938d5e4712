// SPDX-License-Identifier: Apache-2.0
// The origin that a recording names: digests, and what a replay refuses or warns of.
#include "runtime/session/origin.h"

#include <gtest/gtest.h>

#include <fstream>
#include <string>

#include "tests/support/temporary_folder.h"

namespace trocar::runtime {
namespace {

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
