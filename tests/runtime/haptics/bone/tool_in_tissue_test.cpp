// SPDX-License-Identifier: Apache-2.0
#include "runtime/haptics/bone/tool_in_tissue.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace trocar::runtime {
namespace {

// Cancellous bone: 4 MPa, 500 N/m, 300 MPa and no friction on the faces unless said.
CutMaterial bone() {
  CutMaterial t;
  t.strength_Pa = 4e6;
  t.tearing_N_per_m = 500;
  t.modulus_Pa = 300e6;
  t.friction_Pa = 2e4;
  t.wall_Pa_per_m = 5e9;
  t.lateral_strength_Pa = 6e6;
  return t;
}
ToolShape tool(ToolKind kind, double outer_radius_m, double half_angle_rad = 0.5) {
  ToolShape s;
  s.kind = kind;
  s.outer_radius_m = outer_radius_m;
  s.half_angle_rad = half_angle_rad;
  return s;
}
constexpr double kFlat = std::numbers::pi / 2;

// Computed by hand: pi 1.525^2 = 7.30617 mm^2 and pi 3.05 = 9.58186 mm; pi 3^2 = 28.27433 mm^2 and pi 6 =
// 18.84956 mm. Times 4 N/mm^2 and 0.5 N/mm.
TEST(ToolInTissue, AnElevenGaugeNeedleAndATrocarInTheSameBone) {
  const ToolInTissue needle =
      tool_in_tissue(tool(ToolKind::kNeedleConical, 1.525e-3, kFlat), bone());
  const ToolInTissue trocar = tool_in_tissue(tool(ToolKind::kTrocar, 3e-3, kFlat), bone());
  EXPECT_NEAR(needle.strength_N, 29.22467 + 4.79093, 1e-4);
  EXPECT_NEAR(trocar.strength_N, 113.09734 + 9.42478, 1e-4);
  // All along the shaft grows as the radius, the tip's stiffness too: 2 * 1.525 mm * 300 MPa /
  // 0.91.
  EXPECT_NEAR(needle.friction_N_per_m, 2e4 * 9.58186e-3, 1e-3);
  EXPECT_NEAR(trocar.friction_N_per_m, 2e4 * 18.84956e-3, 1e-3);
  EXPECT_NEAR(needle.wall_N_per_m2, 5e9 * 3.05e-3, 1e-3);
  EXPECT_NEAR(trocar.wall_strength_N_per_m, 6e6 * 6e-3, 1e-6);
  EXPECT_NEAR(needle.tip_N_per_m, 1.00549e6, 10);
  EXPECT_NEAR(trocar.tip_N_per_m / needle.tip_N_per_m, 3 / 1.525, 1e-12);
}

TEST(ToolInTissue, StrengthIsInProportionToTheShare) {
  const ToolShape s = tool(ToolKind::kTrocar, 3e-3);
  for (const double xi : {0.0, 2.0}) {
    const ToolInTissue whole = tool_in_tissue(s, bone(), 1, xi),
                       part = tool_in_tissue(s, bone(), 0.21, xi);
    EXPECT_NEAR(part.strength_N, 0.21 * whole.strength_N, 1e-12);
    EXPECT_NEAR(part.torsion_Nm, 0.21 * whole.torsion_Nm, 1e-15);
    EXPECT_EQ(part.friction_N_per_m, whole.friction_N_per_m);
  }
  EXPECT_EQ(tool_in_tissue(s, bone(), 0).strength_N, 0);
}

// 8 G with a bore of 3.2 mm: pi (2.0955^2 - 1.6^2) = 5.75263 mm^2, 2 pi (2.0955 + 1.6) = 23.21951
// mm.
TEST(ToolInTissue, AHollowToolStampsARing) {
  ToolShape s = tool(ToolKind::kJamshidi, 2.0955e-3, kFlat);
  s.inner_radius_m = 1.6e-3;
  EXPECT_NEAR(displaced_area_m2(s), 5.75263e-6, 1e-10);
  EXPECT_NEAR(torn_length_m(s), 23.21951e-3, 1e-8);
  const ToolInTissue out = tool_in_tissue(s, bone());
  EXPECT_NEAR(out.strength_N, 4 * 5.75263 + 0.5 * 23.21951, 1e-3);
  EXPECT_NEAR(out.friction_N_per_m, 2e4 * 23.21951e-3, 1e-3);  // the core's too
  EXPECT_NEAR(out.wall_N_per_m2, 5e9 * 4.191e-3, 1e-3);        // guided from outside
}

// A half angle of 30 degrees: cot = 1.7320508; friction on the faces of 0.2 adds 34.641 %.
TEST(ToolInTissue, FrictionOnTheFacesOfATip) {
  CutMaterial t = bone();
  t.tearing_N_per_m = 0;
  t.face_friction = 0.2;
  for (const ToolKind kind :
       {ToolKind::kNeedleBevel, ToolKind::kNeedleConical, ToolKind::kNeedleDiamond}) {
    EXPECT_NEAR(tool_in_tissue(tool(kind, 1.525e-3, std::numbers::pi / 6), t).strength_N,
                29.22467 * 1.3464102, 1e-4);
    EXPECT_NEAR(tool_in_tissue(tool(kind, 1.525e-3, kFlat), t).strength_N, 29.22467, 1e-4);
  }
}

// The force on a wedge of half angle a with the friction angle phi: cot(a + phi) to the side.
TEST(ToolInTissue, ABevelIsPushedToTheSide) {
  CutMaterial t = bone();
  t.tearing_N_per_m = 0;
  for (const double half_angle_rad : {0.2, 0.5, 1.0, 1.4}) {
    for (const double friction : {0.0, 0.1, 0.3}) {
      t.face_friction = friction;
      const ToolInTissue in =
          tool_in_tissue(tool(ToolKind::kNeedleBevel, 1.5e-3, half_angle_rad), t);
      EXPECT_NEAR(in.lateral_N / in.strength_N,
                  std::max(0.0, 1 / std::tan(half_angle_rad + std::atan(friction))), 1e-12);
    }
  }
  EXPECT_EQ(tool_in_tissue(tool(ToolKind::kNeedleConical, 1.5e-3), t).lateral_N, 0);
  EXPECT_EQ(tool_in_tissue(tool(ToolKind::kNeedleBevel, 1.5e-3, kFlat), t).lateral_N, 0);
}

// The moment of the friction on a turned cone and on a ring, summed over narrow rings.
TEST(ToolInTissue, TurningTakesTheMomentOfTheFacesFriction) {
  CutMaterial t = bone();
  t.tearing_N_per_m = 0;
  t.face_friction = 0.25;
  for (const double inner_m : {0.0, 1e-3}) {
    for (const double half_angle_rad : {0.4, kFlat}) {
      for (const double xi : {0.5, 4.0}) {
        ToolShape s = tool(ToolKind::kNeedleConical, 2e-3, half_angle_rad);
        s.inner_radius_m = inner_m;
        double moment_Nm = 0;
        constexpr int kRings = 10'000;
        const double width_m = (s.outer_radius_m - inner_m) / kRings;
        for (int i = 0; i < kRings; ++i) {
          const double r_m = inner_m + (i + 0.5) * width_m;
          const double face_m2 = 2 * std::numbers::pi * r_m * width_m / std::sin(half_angle_rad);
          moment_Nm += t.face_friction * t.strength_Pa * face_m2 * r_m * xi / std::hypot(1, xi);
        }
        EXPECT_NEAR(tool_in_tissue(s, t, 1, xi).torsion_Nm, moment_Nm, 1e-6 * moment_Nm);
        EXPECT_NEAR(tool_in_tissue(s, t, 0.5, xi).torsion_Nm, 0.5 * moment_Nm, 1e-6 * moment_Nm);
      }
    }
  }
}

TEST(ToolInTissue, APointOpensACrackAFlatTipARing) {
  EXPECT_DOUBLE_EQ(torn_length_m(tool(ToolKind::kNeedleConical, 1e-3)), 2e-3);
  EXPECT_DOUBLE_EQ(torn_length_m(tool(ToolKind::kNeedleBevel, 1e-3)), 2e-3);
  EXPECT_DOUBLE_EQ(torn_length_m(tool(ToolKind::kTrocar, 1e-3)), 3e-3);
  EXPECT_DOUBLE_EQ(torn_length_m(tool(ToolKind::kNeedleDiamond, 1e-3)), 4e-3);
  EXPECT_NEAR(torn_length_m(tool(ToolKind::kNeedleBevel, 1e-3, kFlat)), 6.283185e-3, 1e-9);
}

// A turn a second (6.2832 rad/s) at 3 mm and 5 mm/s: xi = 3.76991, 1 + xi^2 = 15.21223.
TEST(ToolInTissue, TwistLowersTheTearing) {
  const ToolShape s = tool(ToolKind::kTrocar, 3e-3, kFlat);
  const double xi = slice_push(s, -2 * std::numbers::pi, 5e-3);
  EXPECT_NEAR(xi, 3.76991, 1e-5);
  const ToolInTissue still = tool_in_tissue(s, bone()), turned = tool_in_tissue(s, bone(), 1, xi);
  EXPECT_NEAR(still.strength_N - turned.strength_N, 9.42478 * (1 - 1 / 15.21223), 1e-4);
  EXPECT_NEAR(turned.torsion_Nm, 3.76991 / 15.21223 * 9.42478 * 3e-3, 1e-7);
  EXPECT_EQ(still.torsion_Nm, 0);
  // The work of the tearing stays: along plus around is the tearing a length of the path's feed.
  const double feed = 5e-3, twist = 2 * std::numbers::pi;
  const double tearing_along = turned.strength_N - 113.09734;
  EXPECT_NEAR(tearing_along * feed + turned.torsion_Nm * twist, 9.42478 * feed, 1e-6);
  // No feed, or a withdrawal: the bound.
  EXPECT_EQ(slice_push(s, 1, 0), kMaxSlicePush);
  EXPECT_EQ(slice_push(s, 1, -1), kMaxSlicePush);
  EXPECT_EQ(slice_push(s, 0, 0), 0);
  EXPECT_GT(tool_in_tissue(s, bone(), 1, kMaxSlicePush).strength_N, 113.09);
}

TEST(ToolInTissue, WhatCannotBeIsNamed) {
  EXPECT_FALSE(error_of(ToolShape{}).has_value());
  ToolShape s = tool(ToolKind::kJamshidi, 1e-3, kFlat);
  EXPECT_TRUE(error_of(s).has_value());  // not hollow
  s.inner_radius_m = 0.8e-3;
  EXPECT_FALSE(error_of(s).has_value());
  s.half_angle_rad = 0.5;  // not flat
  EXPECT_TRUE(error_of(s).has_value());
  s.half_angle_rad = kFlat;
  s.inner_radius_m = 1e-3;
  EXPECT_TRUE(error_of(s).has_value());
  EXPECT_TRUE(error_of(tool(ToolKind::kTrocar, -1e-3)).has_value());
  EXPECT_TRUE(error_of(tool(ToolKind::kTrocar, std::nan(""))).has_value());
  EXPECT_TRUE(error_of(tool(ToolKind::kTrocar, 1e-3, 0)).has_value());
  EXPECT_TRUE(error_of(tool(ToolKind::kTrocar, 1e-3, 1.6)).has_value());
}

TEST(ToolInTissue, Names) {
  for (const ToolKind kind : {ToolKind::kNeedleBevel, ToolKind::kNeedleConical,
                              ToolKind::kNeedleDiamond, ToolKind::kTrocar, ToolKind::kJamshidi})
    EXPECT_EQ(find_tool_kind(name_of(kind)), kind);
  EXPECT_FALSE(find_tool_kind("spoon").has_value());
}

}  // namespace
}  // namespace trocar::runtime
