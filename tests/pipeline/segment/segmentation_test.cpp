// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/segment/segmentation.h"

#include <gtest/gtest.h>

#include <random>

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

TEST(Segmentation, MeanOfMaterialFindsASinglePixelAnywhere) {
  for (std::size_t i = 0; i < 200; ++i) {
    std::vector<float> values(200, 99);
    values[i] = 100;  // the threshold itself is material
    const Field field = segment(image_with(200, 1, values), PixelUnit::kHounsfield, Threshold{100});
    ASSERT_TRUE(mean_of_material(field)) << i;
    EXPECT_EQ(*mean_of_material(field), 100) << i;
  }
}

TEST(Segmentation, MeanOfMaterialIsEmptyWithoutMaterial) {
  const Field field =
      segment(image_with(2, 2, {1, 2, 3, 4}), PixelUnit::kHounsfield, Threshold{100});
  EXPECT_FALSE(mean_of_material(field));
}

TEST(Segmentation, LabelsThatFloatsWouldMergeAreDifferent) {
  const LabelImage image{4, 1, {614454277, 614454280, kMaxLabel, kMaxLabel - 1}};
  const Field field = segment(image, PixelUnit::kHounsfield, Labels{{614454280, kMaxLabel}});
  EXPECT_EQ(field.image.values, (std::vector<float>{0, 1, 1, 0}));
  EXPECT_EQ(field.iso, 0.5F);
  EXPECT_EQ(field.labels, (std::set<int>{614454280, kMaxLabel}));
}

}  // namespace
}  // namespace trocar::pipeline
