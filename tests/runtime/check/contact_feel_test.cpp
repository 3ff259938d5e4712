// SPDX-License-Identifier: Apache-2.0
// The figures of a dry run's contact, from rows made by hand.
#include "runtime/check/dry_run.h"

#include <gtest/gtest.h>

#include <vector>

namespace trocar::runtime {
namespace {

RecordingRow row_at(int tick, double tool_z_m = 0, double force_N = 0) {
  RecordingRow row;
  row.t_s = tick * 1e-3;
  row.tool_m = {0, 0, tool_z_m};
  row.p_m = {0, 0, tool_z_m + 0.1};
  row.wrench_wanted[2] = force_N;
  return row;
}

ContactFeel feel_of(const std::vector<RecordingRow>& rows, std::optional<double> let_go_t_s = {}) {
  ContactFeelMeter meter({0, 0, -0.1}, let_go_t_s);
  for (const RecordingRow& row : rows)
    meter.add(row);
  return meter.feel();
}

RecordingRow cutting_row(int tick, double tool_z_m, double front_z_m, double tip_N, double cut_J) {
  RecordingRow row = row_at(tick, tool_z_m, tip_N);
  row.cutting.front_z_m = front_z_m;
  row.tip_N = tip_N;
  row.cutting.cut_J = cut_J;
  return row;
}

TEST(ContactFeel, TheSnapIsWhatTheTipIsPastTheFrontAndTheFrontsJump) {
  const ContactFeel feel = feel_of({
      cutting_row(0, 0.001, 0, 0, 0),         // above the bone
      cutting_row(1, -0.002, 0, 40, 0),       // 2 mm past the front
      cutting_row(2, -0.004, 0, 80, 0),       // 4 mm
      cutting_row(3, -0.004, -0.003, 20, 1),  // snaps by 3 mm
      cutting_row(4, -0.005, -0.004, 20, 2),
  });
  EXPECT_DOUBLE_EQ(feel.past_front.value, 0.004);
  EXPECT_DOUBLE_EQ(feel.past_front.t_s, 0.002);
  EXPECT_DOUBLE_EQ(feel.front_jump.value, 0.003);
  EXPECT_DOUBLE_EQ(feel.front_jump.t_s, 0.003);
}

// Behind the last slab above a gap, the front is the next bone; the tip has only fallen to where it is.
TEST(ContactFeel, AGapIsNoJump) {
  const ContactFeel feel = feel_of({
      cutting_row(0, -0.0010, -0.001, 20, 1),
      cutting_row(1, -0.0012, -0.006, 0, 2),  // cut through, 4.8 mm above the next bone
      cutting_row(2, -0.0014, -0.006, 0, 2),
      cutting_row(3, -0.0061, -0.006, 5, 2),
  });
  EXPECT_NEAR(feel.front_jump.value, 0.0002, 1e-12);
  EXPECT_NEAR(feel.past_front.value, 0.0001, 1e-12);
}

TEST(ContactFeel, AnAlternationIsFourChangesEachAgainstTheLast) {
  std::vector<RecordingRow> rows;
  const auto force_of = [&](const std::vector<double>& forces_N, std::size_t axis) {
    rows.clear();
    for (std::size_t i = 0; i < forces_N.size(); ++i) {
      rows.push_back(row_at(static_cast<int>(i)));
      rows.back().wrench_wanted[axis] = forces_N[i];
    }
    return feel_of(rows).alternation;
  };
  for (const std::size_t axis : {0U, 1U, 2U}) {
    EXPECT_EQ(force_of({0, 10, 20, 30, 5, 6, 7}, axis).value, 0) << "a break is no alternation";
    EXPECT_EQ(force_of({0, 10, 0, 10, 10, 10, 0, 10}, axis).value, 0) << "three changes";
    EXPECT_EQ(force_of({0, 10, 0, 10, 3}, axis).value, 7);
    EXPECT_EQ(force_of({0, 10, 0, 10, 3}, axis).t_s, 0.004);
    EXPECT_EQ(force_of({0, 10, -30, 60, -40, 50, 0, 2}, axis).value, 50);
  }
}

TEST(ContactFeel, TheRangeOfTheWantedForceAndTheTimesOfContact) {
  const ContactFeel none = feel_of({row_at(0), row_at(1)});
  EXPECT_EQ(none.contact_from_s, -1);
  EXPECT_EQ(none.contact_to_s, -1);
  const ContactFeel feel = feel_of(
      {row_at(0), row_at(1, 0, 0.4), row_at(2, 0, 30), row_at(3, 0, -7), row_at(4, 0, 0.1)});
  EXPECT_EQ(feel.wanted_least_N, -7);
  EXPECT_EQ(feel.wanted_most.value, 30);
  EXPECT_EQ(feel.wanted_most.t_s, 0.002);
  EXPECT_DOUBLE_EQ(feel.contact_from_s, 0.002);
  EXPECT_DOUBLE_EQ(feel.contact_to_s, 0.003);
}

TEST(ContactFeel, AfterLettingGoDistanceAndSpeedAreThePlates) {
  const std::vector<RecordingRow> rows = {row_at(0, 0.1), row_at(1, 0.0), row_at(2, 0.0002),
                                          row_at(3, 0.0003), row_at(4, 0.0)};
  const ContactFeel feel = feel_of(rows, 0.001);
  EXPECT_NEAR(feel.let_go_distance_m, 0.0003, 1e-12) << "not what the hand moved before";
  EXPECT_NEAR(feel.let_go_speed_m_per_s, 0.3, 1e-9);
  EXPECT_EQ(feel_of(rows).let_go_speed_m_per_s, 0) << "the hand holds on";
}

}  // namespace
}  // namespace trocar::runtime
