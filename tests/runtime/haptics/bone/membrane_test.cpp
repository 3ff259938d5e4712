// SPDX-License-Identifier: Apache-2.0
#include "runtime/haptics/bone/bone_volume.h"

#include <gtest/gtest.h>

#include <cmath>

namespace trocar::runtime {
namespace {

TEST(Membrane, AThinLayerLimitsTheCrackOfAPointedTip) {
  ToolShape needle{.kind = ToolKind::kNeedleBevel,
                   .outer_radius_m = 0.7e-3,
                   .inner_radius_m = 0,
                   .half_angle_rad = 0.25};
  // 1.2 kJ/m^2; a layer of 0.3 mm leaves the tip with a width of 2 * 0.3 mm * tan(0.25) = 0.1532 mm.
  EXPECT_NEAR(membrane_break_N(1200, 0.3e-3, needle), 1200 * 0.1532e-3 / 0.61, 2e-4);
  // A thick one opens a crack of the needle's diameter.
  EXPECT_NEAR(membrane_break_N(1200, 5e-3, needle), 1200 * 1.4e-3 / 0.61, 1e-9);
  // A pyramid of three faces opens three radii.
  needle.kind = ToolKind::kTrocar;
  EXPECT_NEAR(membrane_break_N(1200, 5e-3, needle), 1200 * 2.1e-3 / 0.61, 1e-9);
}

TEST(Membrane, AFlatOrHollowTipStampsItsOutline) {
  ToolShape flat{
      .outer_radius_m = 1e-3, .inner_radius_m = 0, .half_angle_rad = std::acos(-1.0) / 2};
  EXPECT_NEAR(membrane_break_N(1000, 1e-4, flat), 1000 * 2 * std::acos(-1.0) * 1e-3 / 0.61, 1e-9);
  const ToolShape hollow{.kind = ToolKind::kJamshidi,
                         .outer_radius_m = 2e-3,
                         .inner_radius_m = 1e-3,
                         .half_angle_rad = std::acos(-1.0) / 2};
  EXPECT_NEAR(membrane_break_N(1000, 1e-4, hollow), 1000 * 2 * std::acos(-1.0) * 3e-3 / 0.61, 1e-9);
}

}  // namespace
}  // namespace trocar::runtime
