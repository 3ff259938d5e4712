// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/read/slice_stack.h"
#include "tests/support/take.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace trocar::pipeline {
namespace {

std::string said(const Result<LabelImage>& result) {
  return result ? "" : result.error().message;
}

TEST(LabelValues, WholeNumbersUpToTheLargestStayAsTheyAre) {
  const std::vector<double> values{0, -0.0, 1, 16777217, 614454277, 614454280, 2147483647, NAN};
  const auto labels = test::take(to_labels(values, 4, 2, "a"));
  EXPECT_EQ(labels.values,
            (std::vector<std::int32_t>{0, 0, 1, 16777217, 614454277, 614454280, kMaxLabel, 0}));
  EXPECT_EQ(labels.not_numbers, 1U);
  EXPECT_EQ(labels.rounded, 0U);
}

TEST(LabelValues, NearlyWholeNumbersAreRoundedAndCounted) {
  const std::vector<double> values{3.0000457, 2.9991, 3, 1e-3, -1e-3, 2147483647.0005};
  const auto labels = test::take(to_labels(values, 3, 2, "a"));
  EXPECT_EQ(labels.values, (std::vector<std::int32_t>{3, 3, 3, 0, 0, kMaxLabel}));
  EXPECT_EQ(labels.rounded, 5U);
  EXPECT_EQ(labels.largest_rounding, 1e-3);
}

TEST(LabelValues, OthersAreRefusedWithVoxelAndValue) {
  for (const auto& [value, text] : {std::pair{2147483648.0, "2147483648"},
                                    {-1.0, "-1"},
                                    {3.0011, "3.0011"},
                                    {-0.002, "-0.002"},
                                    {1.8446744073709552e19, "1.84467440737096e+19"},
                                    {INFINITY, "inf"},
                                    {-INFINITY, "-inf"}}) {
    const std::vector<double> values{1, 2, 3, 4, value, 6};
    const auto labels = to_labels(values, 3, 2, "a slice 7");
    ASSERT_FALSE(labels) << value;
    EXPECT_EQ(labels.error().code, ExitCode::kRefused);
    EXPECT_TRUE(said(labels).starts_with("a slice 7: voxel 1, 1 is " + std::string(text) +
                                         ", which is no label"))
        << said(labels);
  }
}

// Floats above 2^24 may have been other numbers.
TEST(LabelValues, OfFloatsAreRefusedWhereTheyMayHaveMerged) {
  EXPECT_EQ(to_labels(Image{2, 1, {16777216.0F, 5}}, "a")->values,
            (std::vector<std::int32_t>{16777216, 5}));
  EXPECT_NE(said(to_labels(Image{2, 1, {5, 614454272.0F}}, "a")).find("voxel 1, 0 is 614454272"),
            std::string::npos);
}

TEST(LabelValues, PaddingOfFloatsIsBackground) {
  const Image image{3, 1, {kNoData_HU, 5, 0}};
  EXPECT_EQ(to_labels(image, "a", kNoData_HU)->values, (std::vector<std::int32_t>{0, 5, 0}));
  EXPECT_FALSE(to_labels(image, "a"));
}

}  // namespace
}  // namespace trocar::pipeline
