// SPDX-License-Identifier: Apache-2.0
#include "formats/session/trainee.h"

#include <gtest/gtest.h>

#include "formats/base/text.h"

namespace trocar {
namespace {

TEST(TraineeTest, CodesAreShortAndPlain) {
  for (const char* good : {"A", "A-17", "group_2-b", "0123456789abcdefABCDEF-_012345_-"})
    EXPECT_TRUE(is_trainee_code(good)) << good;
  for (const char* bad : {"", "Jane Doe", "a.b", "a/b", "../a", "ä", "a;b", "a=b", "a\n", "<b>",
                          "0123456789abcdefABCDEF-_012345_-x"})
    EXPECT_FALSE(is_trainee_code(bad)) << bad;
  EXPECT_EQ(trainee_code_error(""), "");
  EXPECT_NE(trainee_code_error("a b"), "");
  EXPECT_NE(attempt_error(0), "");
  EXPECT_EQ(attempt_error(1), "");
  EXPECT_EQ(attempt_error(9999), "");
  EXPECT_NE(attempt_error(10000), "");
}

TEST(TraineeTest, OriginKeepsWhatIsStated) {
  for (const Trainee& stated :
       {Trainee{}, Trainee{"A-17", "spine_2026", 3}, Trainee{"", "c", {}}, Trainee{"", "", 9999}}) {
    RecordingOrigin origin;
    origin.entries.emplace_back("program", "0.2.0");
    state_trainee(stated, origin);
    const Result<RecordingOrigin> read = parse_origin(to_text(origin));
    ASSERT_TRUE(read);
    const Result<Trainee> trainee = stated_trainee(*read);
    ASSERT_TRUE(trainee);
    EXPECT_EQ(trainee->code, stated.code);
    EXPECT_EQ(trainee->course, stated.course);
    EXPECT_EQ(trainee->attempt, stated.attempt);
    EXPECT_EQ(trainee->is_stated(), stated.is_stated());
  }
}

TEST(TraineeTest, OriginOfAnotherKindIsRefused) {
  for (const char* text : {"trainee=a.b", "course=a/b", "attempt=0", "attempt=10000", "attempt=1.5",
                           "attempt=x", "attempt=-1", "attempt=99999999999999999999"}) {
    const Result<RecordingOrigin> origin = parse_origin(text);
    ASSERT_TRUE(origin) << text;
    EXPECT_FALSE(stated_trainee(*origin)) << text;
  }
}

TEST(TraineeTest, IsWrittenAsJson) {
  EXPECT_EQ(to_json({}), "null");
  EXPECT_EQ(to_json({"A", "", 3}), R"({"code":"A","course":null,"attempt":3})");
  EXPECT_EQ(to_json({"", "c", {}}), R"({"code":null,"course":"c","attempt":null})");
}

TEST(XrayUseTest, CountsShotsAndTicksOfScreening) {
  XrayUse use;
  for (const int xray : {0, 1, 0, 2, 2, 3, 2, 0, 1, 1}) {
    RecordingRow row;
    row.xray = static_cast<std::uint8_t>(xray);
    use.add(row);
  }
  EXPECT_EQ(use.shots, 4U);
  EXPECT_EQ(use.screening_ticks, 4U);
  EXPECT_DOUBLE_EQ(use.screening_s(500), 0.008);
  EXPECT_FALSE(use.is_screening);
}

TEST(CsvFieldTest, QuotesAndFormulas) {
  EXPECT_EQ(csv_field("plain"), "plain");
  EXPECT_EQ(csv_field(""), "");
  EXPECT_EQ(csv_field("a,b"), "\"a,b\"");
  EXPECT_EQ(csv_field("say \"x\""), "\"say \"\"x\"\"\"");
  EXPECT_EQ(csv_field("two\nlines"), "\"two\nlines\"");
  EXPECT_EQ(csv_field("-1.5e-3"), "-1.5e-3");
  EXPECT_EQ(csv_field("=1+1"), "'=1+1");
  EXPECT_EQ(csv_field("-x"), "'-x");
  EXPECT_EQ(csv_field("-1+2"), "'-1+2");
  EXPECT_EQ(csv_field("-E1"), "'-E1");
  EXPECT_EQ(csv_field("@sum,1"), "\"'@sum,1\"");
}

}  // namespace
}  // namespace trocar
