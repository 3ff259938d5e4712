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

TEST(LabelValues, NearlyWholeNumbersAreRoundedAndCounted) {
  const std::vector<double> values{3.0000457, 2.9991, 3, 1e-3, -1e-3, 2147483647.0005};
  const auto labels = test::take(to_labels(values, 3, 2, "a"));
  EXPECT_EQ(labels.values, (std::vector<std::int32_t>{3, 3, 3, 0, 0, kMaxLabel}));
  EXPECT_EQ(labels.rounded, 5U);
  EXPECT_EQ(labels.largest_rounding, 1e-3);
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
