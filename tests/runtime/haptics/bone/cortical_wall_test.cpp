// SPDX-License-Identifier: Apache-2.0
#include "runtime/haptics/bone/bone_volume.h"

#include <gtest/gtest.h>

namespace trocar::runtime {
namespace {

// The mean of a wall and of the bone behind it, in slices that are thicker than the wall.
TEST(CorticalWall, TheThicknessIsThatOfTheWallThatWasAveraged) {
  for (const double slice_mm : {1.0, 2.0, 3.0}) {
    for (const double wall_mm : {0.5, 0.8, 1.2, 2.0}) {
      if (wall_mm > slice_mm) continue;
      for (const double inside : {-50.0, 120.0, 300.0}) {
        const double mean = (wall_mm * 1200 + (slice_mm - wall_mm) * inside) / slice_mm;
        const double found = wall_thickness_m(mean, inside, 1200, slice_mm * 1e-3);
        if (mean - inside < kMinContrast_HU)
          EXPECT_EQ(found, 0);
        else
          EXPECT_NEAR(found, wall_mm * 1e-3, 1e-12);
      }
    }
  }
}

TEST(CorticalWall, ASlabOfDenserBoneIsAllWall) {
  EXPECT_EQ(wall_thickness_m(1500, 200, 1200, 2e-3), 2e-3);
  EXPECT_EQ(wall_thickness_m(1200, 200, 1200, 2e-3), 2e-3);
}

TEST(CorticalWall, ThereIsNoneWithoutContrast) {
  EXPECT_EQ(wall_thickness_m(350, 200, 1200, 2e-3), 0);
  EXPECT_EQ(wall_thickness_m(200, 350, 1200, 2e-3), 0);
  EXPECT_EQ(wall_thickness_m(3000, 2900, 1200, 2e-3), 0);
}

}  // namespace
}  // namespace trocar::runtime
