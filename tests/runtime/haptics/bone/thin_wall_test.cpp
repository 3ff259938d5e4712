// SPDX-License-Identifier: Apache-2.0
#include "runtime/haptics/bone/bone_volume.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

namespace trocar::runtime {
namespace {

// The limit load of a simply supported plate by the work of one collapse mechanism, a cone around the disc: for a
// yield moment M for each length the work of the hinges in a cone of slope w / (R - a), integrated over r, is
// 2 pi M w R / (R - a) from the circumferential curvature, and 0 in radial direction. Prager's exact load is at
// most this.
TEST(ThinWall, BendingIsBelowTheLoadOfASimpleMechanism) {
  for (const double a : {0.5e-3, 1.5e-3}) {
    for (const double R : {3e-3, 6e-3}) {
      const ThinWall wall{.thickness_m = 8e-4, .free_radius_m = R, .clamping = 2};
      const double moment_N = 100e6 * 8e-4 * 8e-4 / 4;
      const double mechanism_N = 2 * std::numbers::pi * moment_N * R / (R - a);
      EXPECT_LE(bending_N(wall, a), mechanism_N * (1 + 1e-12));
      EXPECT_GE(bending_N(wall, a), 2 * std::numbers::pi * moment_N) << "a point load needs least";
    }
  }
}

TEST(ThinWall, TheWeakerModeBreaksIt) {
  const ThinWall wall{.thickness_m = 1e-3, .free_radius_m = 4e-3};
  // 3 pi 100 MPa (1 mm)^2 / 4 / (1 - 2 * 1.5 / 12) = 314.2 N; 2 pi 1.5 mm 1 mm 51.6 MPa = 486.3 N
  EXPECT_NEAR(bending_N(wall, 1.5e-3), 314.159, 1e-3);
  EXPECT_NEAR(punching_N(wall, 1.5e-3), 486.319, 1e-3);
  EXPECT_EQ(break_N(wall, 1.5e-3), bending_N(wall, 1.5e-3));
  const ThinWall thick{.thickness_m = 3e-3, .free_radius_m = 4e-3};
  EXPECT_EQ(break_N(thick, 1.5e-3), punching_N(thick, 1.5e-3));
  EXPECT_NEAR(bending_N(thick, 1.5e-3), 9 * bending_N(wall, 1.5e-3), 1e-9);
  EXPECT_EQ(bending_N(wall, 9e-3), bending_N(wall, 4e-3)) << "a tip wider than the hole is as wide";
}

TEST(ThinWall, FlowStressFallsWithTheSquareOfDensity) {
  EXPECT_NEAR(cortex_flow_Pa(1.9), 100e6, 1e-3);
  EXPECT_NEAR(cortex_flow_Pa(0.95), 25e6, 1e-3);
  EXPECT_EQ(cortex_flow_Pa(0), 0);
}

}  // namespace
}  // namespace trocar::runtime
