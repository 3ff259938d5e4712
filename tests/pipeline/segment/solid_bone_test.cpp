// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/segment/solid_bone.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <utility>

#include "pipeline/contour/contour.h"
#include "tests/support/memory_stack.h"
#include "tests/support/take.h"

namespace trocar::pipeline {
namespace {

constexpr int kSide = 40;

// A volume of kSide^3 voxels of 1 mm, its values given by a function of the place.
class BlockStack final : public MemoryStack {
 public:
  explicit BlockStack(const std::function<double(double x, double y, double z)>& value) {
    for (int z = 0; z < kSide; ++z) {
      images.push_back(image_of(kSide, kSide, [&](int x, int y) { return value(x, y, z); }));
      planes.push_back(axial_plane(1, z));
      planes.back().T_lps_plane.translation().x() = 100;
    }
  }
};

double from_middle(double x, double y, double z) {
  return std::hypot(x - 20, y - 20, z - 20);
}

SolidBone made(const BlockStack& stack, const SolidOptions& options) {
  return test::take(SolidBone::make(stack, Threshold{226}, SliceAxis::kAxial, options));
}

SolidOptions filling(double close_mm, double fill_mm2) {
  SolidOptions out;
  out.close_mm = close_mm;
  out.fill_mm2 = fill_mm2;
  return out;
}

// A shell of bone around marrow with a hole of about 4 mm on its top, and a bubble of air in it.
BlockStack shell_with_hole() {
  return BlockStack([](double x, double y, double z) {
    const double r = from_middle(x, y, z);
    if (from_middle(x, y, z - 4) < 2) return -900.0;
    if (r < 12) return 50.0;
    const bool in_hole = z > 20 && std::hypot(x - 20, y - 20) < 2;
    return r < 15 && !in_hole ? 600.0 : 0.0;
  });
}

TEST(SolidBone, AShellWithAHoleIsFilledAndItsAirStaysOpen) {
  const BlockStack stack = shell_with_hole();
  const SolidBone solid = made(stack, filling(3, 2500));
  EXPECT_TRUE(solid.inside(20, 20, 15));   // marrow
  EXPECT_FALSE(solid.inside(24, 20, 20));  // air
  EXPECT_FALSE(solid.inside(20, 2, 20));   // outside
  EXPECT_NEAR(solid.filled_mm3(), 4.0 / 3 * M_PI * 12 * 12 * 12, 0.03 * 7238);
  EXPECT_EQ(solid.dropped_mm3(), 0);
}

TEST(SolidBone, PatchesAboveTheLimitStayOpen) {
  const BlockStack stack = shell_with_hole();
  EXPECT_FALSE(made(stack, filling(3, 300)).inside(20, 20, 15));  // 452 mm^2 in the middle
}

TEST(SolidBone, ACanalIsEnclosedInOneDirectionOnlyAndStaysOpen) {
  const BlockStack stack([](double x, double y, double) {
    const double r = std::hypot(x - 20, y - 20);
    return r < 15 && r >= 6 ? 600.0 : 30.0;
  });
  const SolidBone solid = made(stack, filling(3, 2500));
  for (int z = 0; z < kSide; ++z)
    EXPECT_FALSE(solid.inside(z, 20, 20)) << z;
}

// A shaft of bone along z or x in soft tissue: marrow within 7 mm of its axis, which shifts by
// `tilt` for each mm. It is closed at `first` and `last`.
BlockStack shaft(double marrow_HU, double first = -1, double last = kSide, double tilt = 0,
                 bool is_along_x = false) {
  return BlockStack([=](double x, double y, double z) {
    if (is_along_x) std::swap(x, z);
    const double r = std::hypot(x - 20 - tilt * (z - 20), y - 20);
    if (r > 13) return 40.0;
    return r < 7 && z > first && z < last ? marrow_HU : 1200.0;
  });
}

TEST(SolidBone, AShaftThatTheScanCutsIsFilled) {
  const auto expect_filled = [](const BlockStack& stack, int first, const char* what) {
    const SolidBone solid = made(stack, filling(3, 2500));
    EXPECT_NEAR(solid.filled_mm3(), M_PI * 49 * (kSide - first), 0.08 * M_PI * 49 * kSide) << what;
    EXPECT_TRUE(solid.inside(20, 20, 20)) << what;
    EXPECT_TRUE(solid.warnings().empty()) << what;
  };
  expect_filled(shaft(-60), 0, "both ends");
  expect_filled(shaft(-60, 5), 6, "one end");
  expect_filled(shaft(-60, -1, 34), 6, "the other end");
  expect_filled(shaft(40, 5), 6, "one end, red marrow");
  expect_filled(shaft(-60, -1, kSide, 0.2), 0, "oblique");
  expect_filled(shaft(-60, -1, kSide, 0, true), 0, "across the body");
  expect_filled(shaft(-60, 5, kSide, 0, true), 6, "across the body, one end");
}

// As far apart as that, slices of a spine would show openings for nerves.
TEST(SolidBone, ALongShaftIsFilledWhateverIsInIt) {
  BlockStack stack = shaft(40);
  for (int k = 0; k < kSide; ++k)
    stack.planes[k].z_mm = stack.planes[k].T_lps_plane.translation().z() = 2.0 * k;
  const SolidBone solid = made(stack, filling(3, 2500));
  EXPECT_TRUE(solid.inside(20, 20, 20));
  EXPECT_TRUE(solid.warnings().empty());
}

TEST(SolidBone, ATunnelThatMayBeACanalStaysOpenAndIsNamed) {
  const SolidBone solid = made(shaft(30), filling(3, 2500));
  EXPECT_FALSE(solid.inside(20, 20, 20));
  ASSERT_EQ(solid.warnings().size(), 1U);
  EXPECT_EQ(solid.warnings()[0].code, "cavity_cut");
}

TEST(SolidBone, AnAirwayStaysOpenWithItsLining) {
  const BlockStack stack([](double x, double y, double) {
    const double r = std::hypot(x - 20, y - 20);
    return r > 13 ? 40.0 : r > 7 ? 1200.0 : r > 5 ? -40.0 : -900.0;
  });
  const SolidBone solid = made(stack, filling(3, 2500));
  EXPECT_FALSE(solid.inside(20, 20, 20));
  EXPECT_FALSE(solid.inside(20, 26, 20));
}

TEST(SolidBone, SpecksAreDroppedBeforeTheyCloseAGap) {
  // Specks in the hole of the shell, too small for a bone, would close it.
  const BlockStack stack([](double x, double y, double z) {
    const double r = from_middle(x, y, z);
    if (r < 12) return 50.0;
    const double from_axis = std::hypot(x - 20, y - 20);
    if (z > 20 && from_axis < 6) return from_axis < 1.5 && r < 15 ? 600.0 : 0.0;
    return r < 15 ? 600.0 : 0.0;
  });
  SolidOptions options = filling(2.5, 2500);
  EXPECT_TRUE(made(stack, options).inside(20, 20, 15));
  options.min_volume_mm3 = 100;
  const SolidBone solid = made(stack, options);
  EXPECT_FALSE(solid.inside(20, 20, 15));
  EXPECT_FALSE(solid.inside(33, 20, 20));  // the speck
  EXPECT_GT(solid.dropped_mm3(), 10);
}

// Two balls side by side, one larger.
BlockStack two_balls() {
  return BlockStack([](double x, double y, double z) {
    const double a = std::hypot(x - 10, y - 20, z - 20), b = std::hypot(x - 28, y - 20, z - 20);
    return a < 6 || b < 9 ? 400.0 : 0.0;
  });
}

TEST(SolidBone, TheLargestPieceOrTheSeedsPieceStays) {
  const BlockStack stack = two_balls();
  SolidOptions largest;
  largest.largest = 1;
  EXPECT_TRUE(made(stack, largest).inside(20, 28, 20));
  EXPECT_FALSE(made(stack, largest).inside(20, 10, 20));
  SolidOptions seeded;
  seeded.seeds_lps_mm = {{110, 20, 20}};  // the volume begins at x = 100
  EXPECT_FALSE(made(stack, seeded).inside(20, 28, 20));
  EXPECT_TRUE(made(stack, seeded).inside(20, 10, 20));
}

std::string refusal(const BlockStack& stack, const SolidOptions& options) {
  const auto out = SolidBone::make(stack, Threshold{226}, SliceAxis::kAxial, options);
  EXPECT_FALSE(out);
  if (out) return {};
  EXPECT_EQ(out.error().code, ExitCode::kRefused);
  return out.error().message;
}

TEST(SolidBone, WhatCannotBeMadeIsRefused) {
  const BlockStack stack = two_balls();
  SolidOptions in_air;
  in_air.seeds_lps_mm = {{20, 20, 20}};
  EXPECT_NE(refusal(stack, in_air).find("--seed 20,20,20: no material within 10 mm"),
            std::string::npos);
  SolidOptions large;
  large.min_volume_mm3 = 1e6;
  EXPECT_TRUE(refusal(stack, large).starts_with("--min-volume leaves none of the "));
  large.fill_mm2 = 2500;
  large.column = true;
  EXPECT_TRUE(
      refusal(stack, large).starts_with("--min-volume and --keep column leave none of the "));
  SolidOptions column = filling(3, 2500);
  column.column = true;
  EXPECT_NE(refusal(stack, column).find("no spinal canal found"), std::string::npos);
  BlockStack turned = two_balls();
  turned.planes[7].T_lps_plane.rotate(Eigen::AngleAxisd(0.1, Eigen::Vector3d::UnitX()));
  EXPECT_NE(refusal(turned, filling(0, 10)).find("slice 7"), std::string::npos);
}

// The body is no vessel with contrast medium if the threshold is one for skin.
TEST(SolidBone, ContrastIsSearchedForWithAThresholdOfBoneOnly) {
  const auto ball = [](double inside_HU, double outside_HU) {
    return BlockStack([=](double x, double y, double z) {
      return from_middle(x, y, z) < 15 ? inside_HU : outside_HU;
    });
  };
  SolidOptions options = filling(0, std::numeric_limits<double>::infinity());
  options.min_volume_mm3 = 1000;
  options.largest = 1;
  const auto warnings = [&options](const BlockStack& stack, double threshold_HU) {
    return std::vector(
        test::take(SolidBone::make(stack, Threshold{threshold_HU}, SliceAxis::kAxial, options))
            .warnings());
  };
  EXPECT_TRUE(warnings(ball(60, -1000), -300).empty());
  EXPECT_TRUE(warnings(ball(300, 40), 99).empty());
  const std::vector<Warning> named = warnings(ball(300, 40), 100);
  ASSERT_EQ(named.size(), 1U);
  EXPECT_EQ(named[0].code, "contrast_filled");
}

// The outline is unchanged to the bit where no voxel was changed, and the field agrees with the
// mask.
TEST(SolidBone, TheOuterOutlineStaysWhereItWas) {
  const BlockStack stack = shell_with_hole();
  const SolidBone solid = made(stack, filling(3, 2500));
  for (const int z : {10, 14, 20}) {
    Field plain = segment(*stack.read(z), PixelUnit::kHounsfield, Threshold{226});
    Field filled = plain;
    ASSERT_TRUE(solid.apply(z, 0, 0, filled));
    for (int i = 0; i < kSide * kSide; ++i)
      ASSERT_EQ(filled.image.values[i] >= filled.iso, solid.inside(z, i % kSide, i / kSide));
    const PixelGrid grid;
    const Pslg before = contours(plain, grid, ContourKind::kSubpixel);
    const Pslg after = contours(filled, grid, ContourKind::kSubpixel);
    ASSERT_EQ(after.rings.size(), 1U);
    ASSERT_GT(before.rings.size(), 1U);
    EXPECT_NE(std::find(before.rings.begin(), before.rings.end(), after.rings[0]),
              before.rings.end());
  }
}

TEST(SolidBone, AChangedPixelBesideAnEqualOneMeetsItHalfWay) {
  Field field{{4, 1, {50, 50, 50, 50}}, 226};
  const BlockStack stack([](double x, double, double) { return x < 2 ? 400.0 : 50.0; });
  SolidOptions all;
  all.largest = 1;
  const SolidBone solid = made(stack, all);
  ASSERT_TRUE(solid.apply(0, 0, 0, field));
  EXPECT_EQ(field.image.values, (std::vector<float>{402, 402, 50, 50}));  // 226 lies in the middle
}

TEST(SolidBone, TheMeanIsThatOfTheValuesBefore) {
  const BlockStack stack = shell_with_hole();
  const SolidBone solid = made(stack, filling(3, 2500));
  Field field = segment(*stack.read(20), PixelUnit::kHounsfield, Threshold{226});
  double sum = 0;
  int count = 0;
  for (int i = 0; i < kSide * kSide; ++i) {
    if (!solid.inside(20, i % kSide, i / kSide)) continue;
    sum += static_cast<double>(field.image.values[i]);
    ++count;
  }
  const auto mean = test::take(solid.apply(20, 0, 0, field));
  EXPECT_NEAR(mean, sum / count, 1e-9);
  EXPECT_LT(mean, 500);  // marrow counts
}

}  // namespace
}  // namespace trocar::pipeline
