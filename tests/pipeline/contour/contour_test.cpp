// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/contour/contour.h"

#include <gtest/gtest.h>

#include "formats/mesh/mesh_validity.h"
#include "tests/support/synthetic_fields.h"

namespace trocar::pipeline {
namespace {

constexpr PixelGrid kUnit{1.0, 1.0, 0, 0, Lattice{8}};

double area_px(const Pslg& pslg) {
  return 0.5 * static_cast<double>(doubled_area(pslg)) / (256.0 * 256.0);
}

Field field_of(int width, int height, const std::string& pixels) {  // '#' is material
  Field field{{width, height, {}}, 0.5F};
  for (const char c : pixels)
    field.image.values.push_back(c == '#' ? 1.0F : 0.0F);
  return field;
}

// At 64 positions of the disc on the pixel grid, among them symmetric ones, where the errors of all
// four quadrants are equal.
TEST(SubpixelContour, AreaOfDiscsIsAccurate) {
  struct Case {
    double radius, worst;
  };
  for (const double blur_px : {0.0, 0.5, 1.0}) {
    for (const Case& c : {Case{20, 0.001}, Case{20.3, 0.001}, Case{5, 0.01}, Case{5.3, 0.01}}) {
      const int size = c.radius > 10 ? 64 : 24;
      const double exact = std::numbers::pi * c.radius * c.radius;
      for (int k = 0; k < 64; ++k) {
        const double centre = 0.5 * size;  // a whole number: both sizes are even
        const Field field = disc_field(size, centre + 0.125 * (k % 8), centre + 0.125 * (k >> 3),
                                       c.radius, blur_px);
        const Pslg rings = contours(field, kUnit, ContourKind::kSubpixel);
        ASSERT_EQ(rings.rings.size(), 1U);
        EXPECT_NEAR(area_px(rings) / exact, 1, c.worst)
            << "radius " << c.radius << " blur " << blur_px << " position " << k;
      }
    }
  }
}

TEST(SubpixelContour, MasksAreOutlinedHalfWayBetweenPixels) {
  Field mask = field_of(6, 5,
                        "......"
                        ".##.#."
                        ".####."
                        "...#.."
                        "......");
  mask.is_mask = true;
  for (const Ring& ring : contours(mask, kUnit, ContourKind::kSubpixel).rings) {
    for (const LatticePoint p : ring)
      EXPECT_TRUE((p.x % 256 == 0 && p.y % 256 == 128) || (p.x % 256 == 128 && p.y % 256 == 0));
  }
}

TEST(PixelContour, RunsThroughPixelCentres) {
  const Pslg rings = contours(field_of(4, 4, "....####.##....."), kUnit, ContourKind::kPixel);
  ASSERT_EQ(rings.rings.size(), 1U);
  EXPECT_DOUBLE_EQ(area_px(rings), 2.0);  // (0,1) (3,1) (2,2) (1,2)
}

TEST(PixelContour, DropsMaterialWithoutAreaAndSplitsAtSharedPixels) {
  // A one-pixel line and a lone pixel have no area between pixel centres.
  EXPECT_TRUE(
      contours(field_of(5, 3, "......####....."), kUnit, ContourKind::kPixel).rings.empty());
  EXPECT_TRUE(contours(field_of(3, 3, "....#...."), kUnit, ContourKind::kPixel).rings.empty());
  // Two blocks joined by a line: two rings. Two blocks sharing a corner pixel: touching rings.
  const Pslg joined = contours(field_of(7, 2,
                                        "##...##"
                                        "#######"),
                               kUnit, ContourKind::kPixel);
  EXPECT_EQ(joined.rings.size(), 2U);
  const Pslg touching = contours(field_of(5, 3,
                                          "##.##"
                                          "#####"
                                          "##.##"),
                                 kUnit, ContourKind::kPixel);
  EXPECT_EQ(touching.rings.size(), 2U);
  EXPECT_TRUE(check_pslg(touching));
  // Only the corners of a ring one pixel wide remain, cut off by the hole's chain.
  const Pslg frame = contours(field_of(4, 4, "#####..##..#####"), kUnit, ContourKind::kPixel);
  EXPECT_TRUE(check_pslg(frame));
  EXPECT_DOUBLE_EQ(area_px(frame), 4 * 0.5);
}

TEST(SubpixelContour, MaterialEndsAtTheEdgeOfTheImagesOutermostPixels) {
  const Pslg full = contours(field_of(3, 2, "######"), kUnit, ContourKind::kSubpixel);
  ASSERT_EQ(full.rings.size(), 1U);
  // 3 x 2 pixels minus the four corners, each cut off at half a pixel.
  EXPECT_DOUBLE_EQ(area_px(full), 6.0 - 4 * 0.125);
}

TEST(SubpixelContour, SaddlesFollowTheAsymptoticDecider) {
  const auto count = [](float a, float b, float c, float d) {
    return contours({{2, 2, {a, b, d, c}}, 0.0F}, kUnit, ContourKind::kSubpixel).rings.size();
  };
  EXPECT_EQ(count(3, -1, 3, -1), 1U);  // the saddle is inside: one island
  EXPECT_EQ(count(1, -3, 1, -3), 2U);
}

TEST(SubpixelContour, CropsKeepThePlanesCoordinates) {
  const Field whole = disc_field(64, 30.3, 33.7, 12.0);
  Field part{{40, 50, {}}, whole.iso};
  for (int y = 10; y < 60; ++y) {
    for (int x = 12; x < 52; ++x)
      part.image.values.push_back(whole.image.at(x, y));
  }
  PixelGrid grid = kUnit;
  grid.offset_x = 12;
  grid.offset_y = 10;
  EXPECT_EQ(contours(whole, kUnit, ContourKind::kSubpixel).rings,
            contours(part, grid, ContourKind::kSubpixel).rings);
}

TEST(Contours, DropSmallRingsDropsHolesAndIslands) {
  Pslg rings = contours(field_of(9, 9,
                                 "#########"
                                 "#########"
                                 "##.######"
                                 "#########"
                                 "####...##"
                                 "####...##"
                                 "####...##"
                                 "#########"
                                 "#########"),
                        kUnit, ContourKind::kSubpixel);
  EXPECT_EQ(rings.rings.size(), 3U);
  EXPECT_EQ(drop_small_rings(rings, 2.0, Lattice{8}).rings.size(), 2U);
  EXPECT_EQ(drop_small_rings(rings, 1000.0, Lattice{8}).rings.size(), 0U);
}

// Property: for any field the outline is valid, and a pixel's centre is inside it if and only if
// the pixel is material.
class AnyField : public testing::TestWithParam<std::tuple<int, bool, ContourKind>> {};

TEST_P(AnyField, GivesAValidOutline) {
  const auto [passes, rounded, kind] = GetParam();
  for (std::uint64_t seed = 0; seed < 40; ++seed) {
    const Field field = noise_field(48, passes, seed, rounded);
    for (const double spacing : {1.0, 0.3125, 0.957}) {
      const PixelGrid grid{spacing, 2 * spacing, 3, 5, Lattice{8}};
      const Pslg rings = contours(field, grid, kind);
      const auto ok = check_pslg(rings);
      ASSERT_TRUE(ok) << ok.error().message << " seed " << seed;
      if (kind == ContourKind::kPixel) continue;  // its rim pixels lie on the outline
      for (int k = 0; k < 60; ++k) {
        const int x = (k * 31) % 48, y = (k * 17 + k / 7) % 48;
        const LatticePoint p{grid.lattice.snap_mm((x + 3) * spacing),
                             grid.lattice.snap_mm((y + 5) * 2 * spacing)};
        int winding = 0;
        for (const Ring& ring : rings.rings) {
          for (std::size_t i = 0; i < ring.size(); ++i) {
            const LatticePoint a = ring[i], b = ring[(i + 1) % ring.size()];
            if (a.y <= p.y && b.y > p.y && orient2d(a, b, p) > 0) ++winding;
            if (a.y > p.y && b.y <= p.y && orient2d(a, b, p) < 0) --winding;
          }
        }
        ASSERT_EQ(winding, field.image.at(x, y) >= field.iso ? 1 : 0)
            << "pixel " << x << ", " << y << " seed " << seed;
      }
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Noise, AnyField,
                         testing::Combine(testing::Values(0, 1, 2, 4, 8), testing::Bool(),
                                          testing::Values(ContourKind::kSubpixel,
                                                          ContourKind::kPixel)));

}  // namespace
}  // namespace trocar::pipeline
