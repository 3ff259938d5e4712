// SPDX-License-Identifier: Apache-2.0
// The origin that a recording names: digests, and what a replay refuses or warns of.
#include "runtime/session/origin.h"

#include <gtest/gtest.h>

#include <fstream>
#include <string>

#include "tests/support/temporary_folder.h"

namespace trocar::runtime {
namespace {

TEST(Origin, TheDigestIsThatOfB2sum) {
  const test::TemporaryFolder folder;
  std::ofstream(folder / "abc") << "abc";
  const auto digest = digest_of(folder / "abc");
  ASSERT_TRUE(digest);
  EXPECT_EQ(*digest, "bddd813c634239723171ef3fee98579b94964e3bb1cb3e427262c8c068d52319");
  EXPECT_FALSE(digest_of(folder / "absent"));
  std::ofstream(folder / "long") << std::string(3'000'001, 'x');
  ASSERT_TRUE(digest_of(folder / "long"));
}

TEST(Origin, AReplayNeedsTheSameInputs) {
  const RecordingOrigin run{{{"program", TROCAR_VERSION}, {"scene", "1"}, {"rate_Hz", "997.3"}}};
  EXPECT_EQ(stated_rate_Hz(run), 997.3);
  EXPECT_EQ(stated_rate_Hz({}), 0);
  const auto same = check_replay(run, run, "r.csv");
  ASSERT_TRUE(same);
  EXPECT_EQ(*same, "");
  const auto none = check_replay({}, run, "r.csv");
  ASSERT_FALSE(none);
  EXPECT_EQ(none.error().message, "r.csv: does not say what it was recorded with");
  RecordingOrigin other = run;
  other.entries[0].second = std::string("0.0.1");
  const auto version = check_replay(other, run, "r.csv");
  ASSERT_TRUE(version);
  EXPECT_NE(version->find("version 0.0.1"), std::string::npos);
  other.entries[1].second = std::string("2");
  const auto refused = check_replay(other, run, "r.csv");
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, ExitCode::kRefused);
  EXPECT_EQ(refused.error().message,
            "r.csv: was recorded with other inputs: the scene (2, here 1); give those that it was "
            "recorded with");
}

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
