// SPDX-License-Identifier: Apache-2.0
// The table of procedures: what is fitted, on which rows, and what only shows.
#include "tests/bench/procedures.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <stdexcept>

namespace trocar::test {
namespace {

TEST(Procedures, TwoConstantsAreFittedOnTwoRowsThatSaySo) {
  const auto rows = procedures();
  EXPECT_EQ(std::count_if(rows.begin(), rows.end(),
                          [](const Procedure& p) { return p.standing == Standing::kFitted; }),
            2);
  const BoneConstants constants = fit(rows);
  EXPECT_GT(constants.friction, 0.05);
  EXPECT_LT(constants.friction, 0.6);
  EXPECT_GT(constants.pressure_over_yield, 0.5);
  EXPECT_LT(constants.pressure_over_yield, 3);  // a punch on a solid that keeps its volume
  for (const Procedure& p : rows)
    if (p.standing == Standing::kFitted) {
      EXPECT_NEAR(predict(p, constants), p.published_low, 0.01 * p.published_low) << p.name;
    }
}

TEST(Procedures, OtherRowsAreNotPartOfTheFit) {
  const auto rows = procedures();
  const BoneConstants as_is = fit(rows);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    auto changed = rows;
    changed[i].published_low *= 1.3;
    changed[i].published_high *= 1.3;
    const BoneConstants other = fit(changed);
    const bool same =
        other.friction == as_is.friction && other.pressure_over_yield == as_is.pressure_over_yield;
    EXPECT_EQ(same, rows[i].standing != Standing::kFitted) << rows[i].name;
  }
  auto none = rows;
  for (Procedure& p : none)
    p.standing = Standing::kPredicted;
  EXPECT_THROW(fit(none), std::invalid_argument);
  auto all = rows;
  for (Procedure& p : all)
    p.standing = Standing::kFitted;
  EXPECT_THROW(fit(all), std::invalid_argument);
}

TEST(Procedures, EachRowSaysItsConditionsAndSource) {
  for (const Procedure& p : procedures()) {
    EXPECT_FALSE(p.tool.empty() || p.tissue.empty() || p.conditions.empty() || p.source.empty())
        << p.name;
    EXPECT_LE(p.published_low, p.published_high) << p.name;
    EXPECT_GT(p.published_low, 0) << p.name;
    EXPECT_FALSE(runtime::error_of(p.shape).has_value()) << p.name;
  }
}

// The law reproduces its input values. A prediction outside of the published range stays one.
TEST(Procedures, GivenForcesAreRenderedAndMissesAreFound) {
  const auto rows = procedures();
  const BoneConstants constants = fit(rows);
  for (const Procedure& p : rows) {
    if (p.standing == Standing::kGiven) {
      EXPECT_NEAR(predict(p, constants), p.layers[0].puncture_N, 0.05) << p.name;
    }
  }
  Procedure p = rows[0];
  EXPECT_TRUE(is_hit(p, 90));
  EXPECT_TRUE(is_hit(p, 107));
  EXPECT_FALSE(is_hit(p, 109));
  p.published_high = 100;
  EXPECT_TRUE(is_hit(p, 99));
  EXPECT_FALSE(is_hit(p, 101));
}

}  // namespace
}  // namespace trocar::test
