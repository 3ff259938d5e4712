// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/segment/segmentation.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

#include "pipeline/read/slice_stack.h"
#include "tests/support/take.h"

namespace trocar::pipeline {
namespace {

Image image_with(int width, int height, std::vector<float> values) {
  return {width, height, std::move(values)};
}

TEST(Segmentation, MeanOfMaterialIsOverValuesAtOrAboveTheThreshold) {
  std::mt19937_64 random(1);
  for (const int width : {1, 3, 8, 17, 64}) {
    std::vector<float> values(static_cast<std::size_t>(width) * 5);
    for (float& value : values)
      value = static_cast<float>(static_cast<int>(random() % 2000) - 1000) + 0.25F;
    values[0] = 100;  // the threshold itself is material
    const Field field =
        segment(image_with(width, 5, values), PixelUnit::kHounsfield, Threshold{100});
    long double sum = 0;
    int count = 0;
    for (const float value : values) {
      if (value < 100) continue;
      sum += value;
      ++count;
    }
    ASSERT_TRUE(mean_of_material(field));
    EXPECT_NEAR(*mean_of_material(field), static_cast<double>(sum / count), 1e-9);
  }
}

TEST(Segmentation, MeanOfMaterialFindsASinglePixelAnywhere) {
  for (std::size_t i = 0; i < 200; ++i) {
    std::vector<float> values(200, 0);
    values[i] = 300;
    const Field field = segment(image_with(200, 1, values), PixelUnit::kHounsfield, Threshold{100});
    EXPECT_EQ(mean_of_material(field), 300) << i;
  }
}

TEST(Segmentation, MeanOfAnotherImagesValuesOverTheMaterial) {
  std::vector<std::int32_t> labels(13, 0);
  std::vector<float> hu(13, -500);
  for (const std::size_t i : {1, 2, 11}) {
    labels[i] = 7;
    hu[i] = 100.0F * static_cast<float>(i);
  }
  const Field field = segment(LabelImage{13, 1, labels}, PixelUnit::kUncalibrated, Labels{{7}});
  ASSERT_TRUE(mean_of_material(field, image_with(13, 1, hu)));
  EXPECT_EQ(*mean_of_material(field, image_with(13, 1, hu)), 1400.0 / 3);
}

TEST(Segmentation, LabelsThatFloatsWouldMergeAreDifferent) {
  const LabelImage image{4, 1, {614454277, 614454280, kMaxLabel, kMaxLabel - 1}};
  const Field field = segment(image, PixelUnit::kHounsfield, Labels{{614454280, kMaxLabel}});
  EXPECT_EQ(field.image.values, (std::vector<float>{0, 1, 1, 0}));
  EXPECT_EQ(field.iso, 0.5F);
  EXPECT_EQ(field.labels, (std::set<int>{614454280, kMaxLabel}));
}

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
