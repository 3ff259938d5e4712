// SPDX-License-Identifier: GPL-3.0-or-later
// Warnings of one kind as one entry, and lists of numbers for people.
#include <gtest/gtest.h>

#include "pipeline/bake/report.h"
#include "pipeline/read/number_ranges.h"

namespace trocar::pipeline {
namespace {

TEST(Warnings, NumbersThatFollowEachOtherAreARange) {
  EXPECT_EQ(number_ranges({}), "");
  EXPECT_EQ(number_ranges({5}), "5");
  EXPECT_EQ(number_ranges({-2, -1, 0, 3, 5, 6}), "-2-0, 3, 5-6");
  EXPECT_EQ(number_ranges({1, 2, 4}, ","), "1-2,4");
  EXPECT_EQ(named_ranges("slice", {3}), "slice 3");
  EXPECT_EQ(named_ranges("slice", {3, 4}), "slices 3-4");
  std::set<int> odd;
  for (int k = 0; k < 25; ++k)
    odd.insert(2 * k + 1);
  EXPECT_TRUE(number_ranges(odd).ends_with(", 37, 39 and 5 more")) << number_ranges(odd);
}

TEST(Warnings, AnEntryForEachCode) {
  const nlohmann::json out = warnings_json(
      {{"stray", "a", "left out"}, {"tilt", "b", "tilted"}, {"stray", "c", "left out"}},
      {{"angle", 1, "refined to # degrees", 20},
       {"empty", 2, "no material", 0},
       {"angle", 3, "refined to # degrees", 25},
       {"angle", 5, "# triangles are below", 7}});
  ASSERT_EQ(out.size(), 4U);
  EXPECT_EQ(out[0], nlohmann::json({{"code", "stray"},
                                    {"where", "a, c"},
                                    {"sentence", "left out"},
                                    {"places", {"a", "c"}}}));
  EXPECT_EQ(out[1]["where"], "b");
  EXPECT_EQ(out[2]["where"], "slices 1, 3, 5");
  EXPECT_EQ(out[2]["sentence"],
            "refined to 20 to 25 degrees (slices 1, 3); 7 triangles are below (slice 5)");
  EXPECT_EQ(out[2]["slices"], nlohmann::json({1, 3, 5}));
  EXPECT_EQ(out[3]["sentence"], "no material");
}

TEST(Warnings, ManyPlacesAreCounted) {
  std::vector<Warning> many(12, {"stray", "", "left out"});
  for (std::size_t k = 0; k < many.size(); ++k)
    many[k].where = std::to_string(k);
  const nlohmann::json out = warnings_json(many, {});
  EXPECT_EQ(out[0]["where"], "0, 1, 2 and 9 more");
  EXPECT_EQ(out[0]["places"].size(), 12U);
}

}  // namespace
}  // namespace trocar::pipeline
