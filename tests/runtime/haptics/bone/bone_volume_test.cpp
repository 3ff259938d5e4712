// SPDX-License-Identifier: Apache-2.0
// The slabs of a body from its sheets, and what tissues oppose to tools.
#include "runtime/haptics/bone/bone_volume.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>
#include <string>

#include "formats/session/procedures.h"
#include "tests/runtime/haptics/bone/cutting_fixture.h"
#include "tests/support/body_fixture.h"
#include "tests/support/body_slabs.h"

namespace trocar::runtime {
namespace {

using test::body_scene;
using test::bone_volume_of;
using test::cutting_scene;
using test::kHexagon_m2;
using test::kHexagonWidth_m;
using test::refusal_of;
using test::spaced_asset;
using test::square_asset;
using test::stack;

// The slabs of a body from its sheets: extents, what tissues oppose by hand-computed figures, parts
// for a shell, and what is refused.

const BoneByHu kLinear{"kopperdahl-linear", "qct", 8e-4, 0, false};

void expect_extent(const BoneSheet& sheet, double top_m, double bottom_m) {
  EXPECT_NEAR(sheet.top_m, top_m, 1e-12);
  EXPECT_NEAR(sheet.bottom_m, bottom_m, 1e-12);
}

/// Checks that the slabs of a bone volume are in order, and those of a sheet without gaps.
void expect_ordered(const BoneVolume& body) {
  ASSERT_EQ(body.sheet_of_slab.size(), body.slabs.size());
  int slabs = 0;
  for (std::size_t i = 0; i < body.sheets.size(); ++i) {
    const BoneSheet& sheet = body.sheets[i];
    ASSERT_EQ(sheet.first_slab, slabs);
    ASSERT_GE(sheet.slabs, 1);
    slabs += sheet.slabs;
    for (int k = sheet.first_slab; k < slabs; ++k) {
      const CuttingSlab& slab = body.slabs[static_cast<std::size_t>(k)];
      EXPECT_EQ(body.sheet_of_slab[static_cast<std::size_t>(k)], static_cast<int>(i));
      EXPECT_EQ(slab.top_m, k == sheet.first_slab
                                ? sheet.top_m
                                : body.slabs[static_cast<std::size_t>(k - 1)].bottom_m);
      EXPECT_TRUE(slab.bottom_m > slab.top_m || sheet.bottom_m == sheet.top_m);
    }
    EXPECT_EQ(body.slabs[static_cast<std::size_t>(slabs - 1)].bottom_m, sheet.bottom_m);
    if (i == 0) continue;
    EXPECT_EQ(sheet.meets_above, body.sheets[i - 1].meets_below);
    if (sheet.meets_above) {
      EXPECT_EQ(sheet.top_m, body.sheets[i - 1].bottom_m) << "to the bit";
    } else {
      EXPECT_GT(sheet.top_m, body.sheets[i - 1].bottom_m);
    }
  }
  EXPECT_EQ(static_cast<std::size_t>(slabs), body.slabs.size());
}

// The slices of a scene are one body by their distance, whatever their other distances are.
TEST(BoneVolume, SlicesAtMostThreeMillimetresApartAreOneBody) {
  const BoneVolume body =
      bone_volume_of(cutting_scene({0.12, 0.119, 0.1165, 0.1135}), square_asset(4));
  expect_ordered(body);
  expect_extent(body.sheets[0], -0.1205, -0.1195);
  expect_extent(body.sheets[1], -0.1195, -0.11775);
  expect_extent(body.sheets[2], -0.11775, -0.115);
  expect_extent(body.sheets[3], -0.115, -0.112);
}

TEST(BoneVolume, SlicesFartherApartAreShellsOfNoThickness) {
  Scene scene = cutting_scene({0.12, 0.1169, 0.11});
  scene.tissue.shaft = {2, 30, 2e-4, 400};
  const BoneVolume body = bone_volume_of(scene, square_asset(3));
  expect_ordered(body);
  ASSERT_EQ(body.slabs.size(), 3U);
  for (std::size_t i = 0; i < 3; ++i) {
    const CuttingSlab& slab = body.slabs[i];
    const double depth_m = std::array{-0.12, -0.1169, -0.11}[i];
    expect_extent(body.sheets[i], depth_m, depth_m);
    EXPECT_EQ(slab.top_m, slab.bottom_m);
    EXPECT_FALSE(body.sheets[i].meets_above || body.sheets[i].meets_below);
    EXPECT_EQ(slab.strength_top_N, 35);
    EXPECT_EQ(slab.strength_bottom_N, 35);
    // All of the tissue's shaft in the hole of one sheet.
    ASSERT_GT(slab.hole_m, 0);
    EXPECT_NEAR(slab.friction_N_per_m * slab.hole_m, 2, 1e-12);
    EXPECT_NEAR(slab.viscous_N_s_per_m2 * slab.hole_m, 30, 1e-12);
    EXPECT_NEAR(slab.wall_N_per_m2 * slab.hole_m, 400, 1e-9);
  }
  EXPECT_EQ(body.options.tip_N_per_m, 5000);
  EXPECT_EQ(body.options.presliding_m, 2e-4);
}

TEST(BoneVolume, WhereSlicesHaveNoMaterialThereIsNoSlab) {
  Asset asset = spaced_asset(7, 1);
  for (const std::size_t empty : {std::size_t{2}, std::size_t{3}, std::size_t{5}})
    asset.slices[empty].mesh = {};
  // Index 6 is highest: 6, then 4, then 1, 0.
  const BoneVolume body = bone_volume_of(body_scene(0, 6, 0.12), asset);
  expect_ordered(body);
  ASSERT_EQ(body.sheets.size(), 4U);
  expect_extent(body.sheets[0], -0.1205, -0.1195);
  expect_extent(body.sheets[1], -0.1185, -0.1175);
  expect_extent(body.sheets[2], -0.1155, -0.1145);
  expect_extent(body.sheets[3], -0.1145, -0.1135);
  EXPECT_TRUE(body.sheets[2].meets_below);
}

// A scan of thick slices is one body, too.
TEST(BoneVolume, TheSlicesOfASceneBodyMeetAtAnySpacing) {
  for (const double spacing_mm : {0.1, 0.625, 2.0, 5.0, 10.0}) {
    const BoneVolume body = bone_volume_of(body_scene(1, 4, 0.12), spaced_asset(6, spacing_mm));
    expect_ordered(body);
    ASSERT_EQ(body.sheets.size(), 4U);
    EXPECT_NEAR(body.sheets[0].top_m, -0.12 - spacing_mm * 0.5e-3, 1e-12);
    EXPECT_NEAR(body.sheets[3].bottom_m, -0.12 + spacing_mm * 3.5e-3, 1e-12);
    for (std::size_t i = 1; i < 4; ++i)
      EXPECT_TRUE(body.sheets[i].meets_above);
  }
}

// A scan may be thinner in one part than in another.
TEST(BoneVolume, NeighboursInTheAssetMeetAtMixedSpacing) {
  Asset asset = spaced_asset(5, 1);
  for (const std::size_t i : {std::size_t{3}, std::size_t{4}})
    asset.slices[i].z_mm += 2 * (static_cast<double>(i) - 2);  // 0, 1, 2, 5, 8 mm
  const BoneVolume body = bone_volume_of(body_scene(0, 4, 0.12), asset);
  expect_ordered(body);
  ASSERT_EQ(body.sheets.size(), 5U);
  expect_extent(body.sheets[0], -0.1215, -0.1185);
  expect_extent(body.sheets[1], -0.1185, -0.1155);
  expect_extent(body.sheets[2], -0.1155, -0.1135);
  expect_extent(body.sheets[4], -0.1125, -0.1115);
}

TEST(BoneVolume, ATissueWithoutCutIsWhatTheScenesToolFeels) {
  Scene scene = cutting_scene(stack(0.12, 1e-3, 4));
  scene.tissue.threshold_N = 20;
  scene.tissue.stiffness_N_per_m = 8000;
  const BoneVolume body = bone_volume_of(scene, square_asset(4));
  EXPECT_NEAR(2 * body.radius_m, kHexagonWidth_m, 1e-9);
  EXPECT_EQ(body.options.tip_N_per_m, 8000);
  for (const BoneSheet& sheet : body.sheets) {
    EXPECT_EQ(sheet.nominal_N, 20);
    EXPECT_EQ(sheet.tip_N_per_m, 8000);
    EXPECT_EQ(sheet.strength_N(body.shape, -1000), 20);
    EXPECT_EQ(sheet.strength_N(body.shape, 2000), 20);
  }
  for (const CuttingSlab& slab : body.slabs) {
    EXPECT_EQ(slab.strength_top_N, 20);
    EXPECT_EQ(slab.strength_bottom_N, 20);
    EXPECT_EQ(slab.friction_N_per_m, 0);
    // 8000 N/m and 20 N over 23.38 mm^2, over a width of 5.456 mm.
    EXPECT_NEAR(slab.wall_N_per_m2, 8000 / 23.382686e-6 * 5.4563505e-3, 5);
    EXPECT_NEAR(slab.wall_strength_N_per_m, 20 / 23.382686e-6 * 5.4563505e-3, 0.02);
  }
}

TEST(BoneVolume, ATissueThatIsCutOpposesByAreaPerimeterAndWall) {
  Scene scene = cutting_scene(stack(0.12, 1e-3, 4));
  CutTissue cut;
  cut.strength_MPa = 4;
  cut.tearing_N_per_m = 500;
  cut.friction_kPa = 20;
  cut.foundation_N_per_mm3 = 10;
  cut.lateral_strength_MPa = 12;
  scene.tissue.cut = cut;
  const BoneVolume body = bone_volume_of(scene, square_asset(4));
  for (const CuttingSlab& slab : body.slabs) {
    // 4 MPa * 23.382686 mm^2 + 500 N/m * 18 mm
    EXPECT_NEAR(slab.strength_top_N, 93.530744 + 9, 1e-5);
    EXPECT_NEAR(slab.strength_bottom_N, 102.530744, 1e-5);
    EXPECT_NEAR(slab.friction_N_per_m, 360, 1e-9);            // 20 kPa * 18 mm
    EXPECT_NEAR(slab.wall_N_per_m2, 54.563505e6, 10);         // 10 N/mm^3 * 5.456 mm
    EXPECT_NEAR(slab.wall_strength_N_per_m, 65476.206, 0.1);  // 12 MPa * 5.456 mm
  }
  // An 11 G needle, 3.05 mm, in the same bone: a disc of 32 sides.
  scene.tool.sides = 32;
  scene.tool.radius_m = 1.525e-3;
  const BoneVolume needle = bone_volume_of(scene, square_asset(4));
  const double area_m2 = 16 * 1.525e-3 * 1.525e-3 * std::sin(std::acos(-1.0) / 16),
               outline_m = 64 * 1.525e-3 * std::sin(std::acos(-1.0) / 32);
  EXPECT_NEAR(needle.slabs[0].strength_top_N, 4e6 * area_m2 + 500 * outline_m, 1e-9);
  EXPECT_NEAR(needle.slabs[0].friction_N_per_m, 20e3 * outline_m, 1e-9);
  // The scene's shaft adds to what the tissue does over its area.
  scene.tissue.shaft.dry_friction_N = 0.5;
  EXPECT_NEAR(bone_volume_of(scene, square_asset(4)).slabs[0].friction_N_per_m,
              needle.slabs[0].friction_N_per_m + 500, 1e-9)
      << "0.5 N over a slab of 1 mm";
}

TEST(BoneVolume, BoneHasTheStrengthOfItsHu) {
  Scene scene = cutting_scene(stack(0.12, 1e-3, 3));
  scene.tissue.cut.emplace().bone = kLinear;
  scene.tissue.cut->tearing_N_per_m = 100;
  const BoneVolume body = bone_volume_of(scene, spaced_asset(3, 1, {200, 400, 20}));
  // -0.75 + 24.9 * 8e-4 HU, in MPa, over 23.38 mm^2, and 100 N/m * 18 mm.
  const auto N = [](double hu) {
    return std::max(0.16, -0.75 + 24.9 * 8e-4 * hu) * 1e6 * kHexagon_m2 + 1.8;
  };
  EXPECT_NEAR(body.sheets[0].nominal_N, N(200), 1e-9);
  EXPECT_NEAR(body.sheets[0].nominal_N, 75.6196 + 1.8, 1e-3);
  EXPECT_NEAR(body.sheets[1].nominal_N, N(400), 1e-9);
  EXPECT_NEAR(body.sheets[2].nominal_N, 3.7412 + 1.8, 1e-3)
      << "the least strength, below the law's root";
  for (const double hu : {-1000.0, 0.0, 38.0, 250.0, 1500.0})
    EXPECT_NEAR(body.sheets[0].strength_N(body.shape, hu), N(hu), 1e-9) << hu;
  EXPECT_TRUE(body.sheets[0].calibration.is_assumed);
  scene.tissue.cut->bone = BoneByHu{"kopperdahl-power", "qct", 1e-3, 0.05, true};
  const BoneVolume power = bone_volume_of(scene, spaced_asset(3, 1, {200, 400, 20}));
  EXPECT_NEAR(power.sheets[0].nominal_N, 37.4e6 * std::pow(0.25, 1.39) * kHexagon_m2 + 1.8, 1e-9);
  EXPECT_FALSE(power.sheets[0].calibration.is_assumed);
}

// A shell without support breaks as a thin wall where that needs less force, by the density under
// the tool.
TEST(BoneVolume, AShellWithoutSupportBreaksAsAThinWall) {
  Scene scene = body_scene(0, 2, 0.12);
  scene.body->shell_m = 8e-4;
  scene.body->shell_factor = 2;
  scene.body->shell_free_radius_m = 5e-3;
  EXPECT_NE(refusal_of(scene, square_asset(3)).find("/body/shell/free_radius_m"), std::string::npos)
      << "its density is not known";
  scene.tissue.cut = CutTissue{};
  scene.tissue.cut->bone = BoneByHu{"kopperdahl-power", "qct", 8e-4, 0, false};
  const BoneVolume body = bone_volume_of(scene, spaced_asset(3, 1, {900, 900, 900}));
  const BoneSheet& sheet = body.sheets[0];
  for (const double hu : {200.0, 600.0, 1400.0}) {
    const double apparent = 8e-4 * hu / 0.598, flow_Pa = 100e6 * std::pow(apparent / 1.9, 2);
    const double wall_N = break_N({.thickness_m = 8e-4, .free_radius_m = 5e-3, .flow_Pa = flow_Pa},
                                  body.shape.outer_radius_m);
    EXPECT_NEAR(sheet.shell_N(body.shape, hu, 1e6), wall_N, 1e-9 * wall_N);
    EXPECT_NEAR(sheet.shell_N(body.shape, hu, wall_N / 4), wall_N / 2, 1e-9)
        << "crushed before that";
  }
  scene.body->shell_free_radius_m = 0;
  EXPECT_EQ(bone_volume_of(scene, spaced_asset(3, 1, {900, 900, 900}))
                .sheets[0]
                .shell_N(body.shape, 900, 100),
            200)
      << "supported";
}

// At the uppermost tissue's mean HU: the lateral force is pressure * area * (cot 30 deg - 0.1).
TEST(BoneVolume, ABevelLooksAlongTheTurnedCrossSection) {
  Scene scene = cutting_scene(stack(0.12, 1e-3, 3));
  scene.tool.kind = "needle-bevel";
  scene.tool.half_angle_deg = 30;
  EXPECT_TRUE(bone_volume_of(scene, spaced_asset(3, 1)).options.tool.bevel_plate.isZero(0))
      << "the tissue states forces of the tool";
  scene.tissue.cut.emplace();
  scene.tissue.cut->strength_MPa = 6;
  scene.tissue.cut->tearing_N_per_m = 4000;
  scene.tissue.cut->friction_coefficient = 0.1;
  for (const double rotation_deg : {0.0, 30.0, 200.0}) {
    scene.tool.rotation_deg = rotation_deg;
    const BoneVolume body = bone_volume_of(scene, spaced_asset(3, 1));
    const double pressed_N =
        body.sheets[0].material.strength_Pa * std::numbers::pi * body.radius_m * body.radius_m;
    const double ratio =
        pressed_N * (1 / std::tan(30 * std::numbers::pi / 180) - 0.1) / body.sheets[0].nominal_N;
    ASSERT_GT(ratio, 0.2);
    ASSERT_LT(ratio, 1.7);
    const double angle_rad = rotation_deg * std::numbers::pi / 180;
    const Eigen::Vector3d wanted(ratio * std::cos(angle_rad), ratio * std::sin(angle_rad), 0);
    EXPECT_TRUE(body.options.tool.bevel_plate.isApprox(wanted, 1e-9));
  }
  scene.tool.kind = "needle-conical";
  EXPECT_TRUE(bone_volume_of(scene, spaced_asset(3, 1)).options.tool.bevel_plate.isZero(0));
}

TEST(BoneVolume, ALayersForceFollowsFromItsToughness) {
  Scene scene = cutting_scene(stack(0.12, 1e-3, 3));
  scene.tool.kind = "needle-conical";
  scene.tool.half_angle_deg = 20;
  SceneLayer layer{.name = "dura", .top_z_m = 0.13, .thickness_m = 4e-4, .stiffness_N_per_m = 150};
  layer.toughness_J_per_m2 = 1500;
  layer.cutting_N = 100;
  layer.cutting_is_given = true;
  scene.layers = {layer, layer, layer};
  scene.layers[2].cutting_is_given = false;
  scene.layers[1].toughness_J_per_m2 = 0;
  scene.layers[1].puncture_N = 7;
  scene.layers[1].cutting_N = 1;
  EXPECT_NE(refusal_of(scene, spaced_asset(3, 1)).find("dura"), std::string::npos)
      << "not resolved";
  ASSERT_TRUE(resolve_layers(scene));
  EXPECT_EQ(bone_volume_of(scene, spaced_asset(3, 1)).layers[0].puncture_N,
            scene.layers[0].puncture_N);
  const double tear_N = 1500 * 2 * 4e-4 * std::tan(20 * std::acos(-1.0) / 180) / 0.61;
  EXPECT_NEAR(scene.layers[0].puncture_N, tear_N, 1e-9);
  EXPECT_EQ(scene.layers[0].cutting_N, scene.layers[0].puncture_N) << "at most that";
  EXPECT_EQ(scene.layers[1].puncture_N, 7);
  EXPECT_EQ(scene.layers[1].cutting_N, 1);
  EXPECT_NEAR(scene.layers[2].cutting_N, 0.61 * tear_N, 1e-9) << "the part that tears";
}

// A tissue that states no stiffness has a tip as stiff as its bone; one that states it keeps it.
TEST(BoneVolume, TheTipsStiffnessIsTheBonesUnlessItIsStated) {
  Scene scene = cutting_scene(stack(0.12, 1e-3, 3));
  scene.tissue.cut.emplace().bone = kLinear;
  const Asset asset = spaced_asset(3, 1, {200, 400, -500});
  const BoneVolume body = bone_volume_of(scene, asset);
  // A flat punch of radius a on a half-space: 2 a E / (1 - nu^2) (I. Sneddon, Int. J. Eng. Sci. 3,
  // 1965).
  const auto modulus_Pa = [&](std::size_t i) {
    return tool_in_tissue(body.shape, body.sheets[i].material).tip_N_per_m;
  };
  for (std::size_t i = 0; i < 3; ++i)
    EXPECT_EQ(body.sheets[i].tip_N_per_m, modulus_Pa(i));
  EXPECT_NEAR(body.sheets[0].material.modulus_Pa, 1e6 * std::max(50.0, -34.7 + 3230 * 8e-4 * 200),
              1e-3);
  EXPECT_NEAR(body.sheets[1].material.modulus_Pa, 1e6 * (-34.7 + 3230 * 8e-4 * 400), 1e-3);
  EXPECT_EQ(body.sheets[2].material.modulus_Pa, 50e6) << "marrow";
  EXPECT_GT(body.sheets[1].tip_N_per_m, 1.5 * body.sheets[0].tip_N_per_m);
  scene.tissue.stiffness_N_per_m = 20'000;
  scene.tissue.stiffness_is_given = true;
  EXPECT_EQ(bone_volume_of(scene, asset).sheets[0].tip_N_per_m, 20'000);
}

/// Checks that a slab ends at the shell's depth below the top and above the bottom of every sheet.
void expect_parts(const BoneVolume& body, double shell_m, const std::string& where) {
  const auto ends_at = [&](double depth_m) {
    return std::any_of(body.slabs.begin(), body.slabs.end(), [&](const CuttingSlab& slab) {
      return std::abs(slab.bottom_m - depth_m) < 2e-6;
    });
  };
  for (const BoneSheet& sheet : body.sheets) {
    const double down_m = sheet.top_m + shell_m, up_m = sheet.bottom_m - shell_m;
    if (down_m < body.slabs.back().bottom_m) {
      EXPECT_TRUE(ends_at(down_m)) << where;
    }
    if (up_m > body.slabs.front().top_m + 1e-9) {
      EXPECT_TRUE(ends_at(up_m)) << where;
    }
  }
}

// Measured from where the tool enters a sheet, and up from where it leaves one, a chunk ends at the
// shell's depth.
TEST(BoneVolume, PartsEndAtTheShellsDepthFromEverySheet) {
  for (const double spacing_mm : {0.5, 1.0, 2.0}) {
    for (const double shell_mm : {0.4, 1.0, 1.5, 2.7, 4.0}) {
      Scene scene = body_scene(0, 23, 0.1237);
      scene.body->shell_m = shell_mm * 1e-3;
      scene.body->shell_factor = 2;
      const BoneVolume body = bone_volume_of(scene, spaced_asset(24, spacing_mm));
      expect_ordered(body);
      for (const BoneSheet& sheet : body.sheets)
        EXPECT_LE(sheet.slabs, 3);
      expect_parts(body, scene.body->shell_m,
                   std::to_string(spacing_mm) + " mm, shell " + std::to_string(shell_mm) + " mm");
    }
  }
  // Slices at 0, 1, 4, 5 and 8 mm.
  Asset asset = spaced_asset(5, 1);
  for (std::size_t i = 2; i < 5; ++i)
    asset.slices[i].z_mm += i == 4 ? 4 : 2;
  for (const double shell_mm : {0.4, 1.0, 1.25, 1.5, 2.7, 4.0, 6.3}) {
    Scene scene = body_scene(0, 4, 0.1237);
    scene.body->shell_m = shell_mm * 1e-3;
    const BoneVolume body = bone_volume_of(scene, asset);
    expect_ordered(body);
    expect_parts(body, scene.body->shell_m, "uneven, shell " + std::to_string(shell_mm) + " mm");
  }
}

TEST(BoneVolume, ItsStiffestIsThatOfTipShaftAndWalls) {
  Scene scene = cutting_scene(stack(0.12, 1e-3, 4));
  scene.tissue.cut = CutTissue{4, std::nullopt, 0, 1, 0, 0, 20, 10, 12};
  scene.tissue.shaft.viscous_friction_N_s_per_m = 3;
  scene.tissue.shaft.presliding_m = 1e-4;
  const BoneVolume body = bone_volume_of(scene, square_asset(4));
  // 360 N/m over 4 mm at 0.1 mm, and the tip.
  EXPECT_NEAR(body.along_N_per_m, 5000 + 360 * 4e-3 / 1e-4, 1e-6);
  EXPECT_NEAR(body.across_N_per_m, 54.563505e6 * 4e-3, 0.1);
  EXPECT_NEAR(body.viscous_N_s_per_m, 12, 1e-9);
  EXPECT_EQ(body.options.presliding_m, 1e-4);
  // Friction 0.3 and hold 0.25 of the strength, at 0.1 mm, and a layer with 200 N/m over 2 mm.
  const double of_tip_N_per_m = 0.55 * body.sheets.front().nominal_N / 1e-4;
  EXPECT_NEAR(body.yielding_N_per_m, of_tip_N_per_m, 1e-6);
  SceneLayer skin;
  skin.name = "skin";
  skin.top_z_m = 0.2;
  skin.thickness_m = 2e-3;
  skin.stiffness_N_per_m = 1000;
  skin.puncture_N = 2;
  skin.cutting_N = 1;
  skin.friction_N_per_m = 200;
  scene.layers = {skin};
  EXPECT_NEAR(bone_volume_of(scene, square_asset(4)).yielding_N_per_m,
              of_tip_N_per_m + 200 * 2e-3 / 1e-4, 1e-6);
}

TEST(BoneVolume, WhatHasNoStrengthIsRefused) {
  Scene scene = cutting_scene({0.12, 0.119});
  const auto with = [&](const BoneByHu& bone, bool has_hu = true) {
    scene.tissue.cut = CutTissue{};
    scene.tissue.cut->bone = bone;
    return refusal_of(scene, has_hu ? spaced_asset(2, 1, {200, 200}) : square_asset(2));
  };
  EXPECT_EQ(with({"kopperdahl-linear", "qct", 8e-4, 0, false}), "");
  const std::string unknown = with({"wolff", "qct", 8e-4, 0, false});
  EXPECT_NE(unknown.find("slice 0: no bone law is called \"wolff\""), std::string::npos) << unknown;
  for (const BoneLaw& law : bone_laws())
    EXPECT_NE(unknown.find(law.name), std::string::npos) << "what there is";
  for (const char* modulus_only : {"morgan", "keller"}) {
    const std::string none = with({modulus_only, "apparent", 8e-4, 0, true});
    EXPECT_NE(none.find("no strength"), std::string::npos) << none;
  }
  const std::string density = with({"kopperdahl-power", "apparent", 8e-4, 0, true});
  EXPECT_NE(density.find("is for QCT mineral density"), std::string::npos) << density;
  EXPECT_NE(density.find("gives apparent density"), std::string::npos) << density;
  const std::string no_hu = with({"kopperdahl-linear", "qct", 8e-4, 0, false}, false);
  EXPECT_NE(no_hu.find("--hu"), std::string::npos) << no_hu;
}

// --- place_body (runtime/haptics/sheet.h) ---

TEST(PlaceBody, TakesTheSlicesWithMaterialAtTheirSpacing) {
  Asset asset = spaced_asset(6, 0.625);
  asset.slices[3].mesh = {};
  Scene scene = body_scene(1, 4, 0.12);
  ASSERT_TRUE(place_body(scene, asset, "a"));
  ASSERT_EQ(scene.slices.size(), 3U);
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_EQ(scene.slices[i].index, (std::array{4, 2, 1})[i]) << "the topmost first";
    EXPECT_NEAR(scene.slices[i].z_m, (std::array{0.12, 0.11875, 0.118125})[i], 1e-15);
  }
  Scene other = cutting_scene({0.12});
  ASSERT_TRUE(place_body(other, asset, "a")) << "without a body nothing is done";
  EXPECT_EQ(other.slices.size(), 1U);
}

TEST(PlaceBody, RefusesWhatIsNoBody) {
  const auto refusal = [](const Asset& asset, int from, int to, double top_m = 0.12) {
    Scene scene = body_scene(from, to, top_m);
    const auto placed = place_body(scene, asset, "a.glb");
    EXPECT_FALSE(placed);
    if (placed) return std::string();
    EXPECT_EQ(placed.error().code, ExitCode::kRefused);
    EXPECT_EQ(placed.error().message.rfind("a.glb: body of slices ", 0), 0U)
        << placed.error().message;
    return placed.error().message;
  };
  EXPECT_NE(refusal(spaced_asset(4, 1), 4, 9).find("material"), std::string::npos);
  EXPECT_NE(refusal(spaced_asset(4, 1), 3, 9).find("fewer than two"), std::string::npos);
  EXPECT_NE(refusal(spaced_asset(4, 0.05), 0, 3).find("less than 0.1 mm"), std::string::npos);
  Asset tilted = spaced_asset(4, 1);
  tilted.slices[2].T_lps_plane.linear() =
      Eigen::AngleAxisd(0.01, Eigen::Vector3d::UnitX()).toRotationMatrix();
  EXPECT_NE(refusal(tilted, 0, 3).find("slices 3 and 2 are not parallel"), std::string::npos);
  EXPECT_NE(refusal(spaced_asset(4, 400), 0, 3).find("1 m"), std::string::npos);
  EXPECT_NE(refusal(spaced_asset(4, 300), 0, 3, -0.5).find("1 m"), std::string::npos)
      << "the lowest would be 1.4 m below the device's origin";
}

// What a body feels like does not depend on where its slices fall.

// Slices at a spacing, the first slab beginning at `from`; each has the mean of its slab.
template <class Mean>
std::vector<BodySlice> slices_of(double from, double to, double spacing, Mean mean) {
  std::vector<BodySlice> slices;
  const auto count = static_cast<int>(std::ceil((to - from) / spacing - 1e-6));
  for (int i = 0; i < count; ++i) {
    const double top = from + i * spacing;
    slices.push_back({.depth_m = top + spacing / 2, .strength_N = mean(top, top + spacing)});
  }
  return slices;
}

// Cancellous bone of 15 N whose strength varies by 20 % over a wavelength.
constexpr double kMean_N = 15, kVaries = 0.2;
double texture(double depth, double wave) {
  return kMean_N * (1 + kVaries * std::sin(2 * std::numbers::pi * depth / wave));
}
double texture_mean(double a, double b, double wave) {
  const double k = 2 * std::numbers::pi / wave;
  return kMean_N * (1 + kVaries * (std::cos(k * a) - std::cos(k * b)) / (k * (b - a)));
}

// The slope is that of the neighbours' line unless an end would exceed both its own and the neighbour's
// strength by more than 5 % of its own.
TEST(Slabs, TheSlopeIsLimitedByTheNeighbours) {
  const auto slope = [](double above_N, double own_N, double below_N) {
    const auto [top_N, bottom_N] = strength_ends(own_N, above_N, 1e-3, below_N, 1e-3, 1e-3);
    EXPECT_DOUBLE_EQ((top_N + bottom_N) / 2, own_N);
    EXPECT_GE(std::min(top_N, bottom_N), 0);
    return bottom_N - top_N;
  };
  EXPECT_DOUBLE_EQ(slope(10, 20, 30), 10) << "a straight line is kept";
  EXPECT_DOUBLE_EQ(slope(30, 20, 10), -10);
  EXPECT_DOUBLE_EQ(slope(10, 12, 40), 2 * (2 + 0.6)) << "the top is at least 0.95 of 12 below 10";
  EXPECT_DOUBLE_EQ(slope(40, 12, 10), -2 * (2 + 0.6));
  EXPECT_DOUBLE_EQ(slope(10, 38, 40), 2 * (2 + 1.9));
  EXPECT_DOUBLE_EQ(slope(10, 40, 12), 1) << "a symmetrical peak has the slope of the line";
  EXPECT_DOUBLE_EQ(slope(10, 40, 38), 2 * 2) << "a peak: at most 5 % above it";
  EXPECT_DOUBLE_EQ(slope(0, 0, 40), 0) << "no strength, no slope";
  EXPECT_DOUBLE_EQ(slope(60, 10, 0.1), -20) << "the bottom has no strength, not a negative one";
  EXPECT_DOUBLE_EQ(slope(0.1, 10, 60), 20);
  // By the distances of the neighbours: 1 and 2 mm here, over a slab of 1.5 mm.
  EXPECT_NEAR(strength_ends(20, 10, 1e-3, 40, 2e-3, 1.5e-3)[1], 27.5, 1e-12);
  EXPECT_NEAR(strength_ends(20, 10, 1e-3, 1, 2e-3, 1.5e-3)[1], 19, 1e-12);
}

// Force over depth within 3 %, work within 1.5 % of the texture itself, wherever the slices begin.
TEST(Slabs, SpacingDoesNotShow) {
  constexpr double kWave = 0.012, kEnd = 0.036;
  double worst_force = 0, worst_work = 0;
  for (const double spacing : {5e-4, 1e-3, 2e-3}) {
    for (int shift = 0; shift < 5; ++shift) {
      const double from = -spacing * shift / 5;
      Bench b(make_slabs(slices_of(from, kEnd, spacing,
                                   [](double x, double y) { return texture_mean(x, y, kWave); })));
      b.options.coupling.translation_N_per_m = 1e5;
      b.options.tip_N_per_m = 1e5;
      double work = 0, expected = 0, last = b.slabs.front().top_m;
      b.push(-0.002, 0.035, 1e-5, [&](const CuttingResult& out, const Pose&) {
        // Not in the first and last slab, whose slope is one-sided.
        if (out.front_m < 0.003 || out.front_m > 0.032 || out.cut_J <= 0) return;
        const double Y = texture(out.front_m, kWave);
        worst_force = std::max(worst_force, std::abs(out.tip_N - Y) / Y);
        if (work > 0) {
          work += out.cut_J;
          expected += texture_mean(last, out.front_m, kWave) * (out.front_m - last);
        } else {
          work = 1e-300;
        }
        last = out.front_m;
      });
      worst_work = std::max(worst_work, std::abs(work / expected - 1));
      EXPECT_GT(expected, 0.3);
    }
  }
  EXPECT_LE(worst_force, 0.03);
  EXPECT_GT(worst_force, 1e-3);  // or nothing was compared
  EXPECT_LE(worst_work, 0.015);
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

const BoneLaw& law(std::string_view name) {
  const BoneLaw* found = find_bone_law(name);
  if (found == nullptr) throw std::invalid_argument("no such law");
  return *found;
}

// Computed by hand, with logarithms: 0.2^1.05 = exp(1.05 * -1.6094379) = 0.184536,
// 0.2^1.39 = exp(-2.2371187) = 0.106765, 0.2^1.56 = exp(-2.5107231) = 0.081210,
// 0.2^1.92 = exp(-3.0901208) = 0.045496.
TEST(BoneStrength, PublishedLawsAtOneDensity) {
  constexpr double kRho = 0.2;
  EXPECT_NEAR(value_of(law("kopperdahl-linear").modulus_MPa, kRho), 611.3, 1e-9);
  EXPECT_NEAR(value_of(*law("kopperdahl-linear").strength_MPa, kRho), 4.23, 1e-9);
  EXPECT_NEAR(value_of(law("kopperdahl-power").modulus_MPa, kRho), 549.91, 0.01);
  EXPECT_NEAR(value_of(*law("kopperdahl-power").strength_MPa, kRho), 3.9930, 1e-4);
  EXPECT_NEAR(value_of(law("morgan").modulus_MPa, kRho), 384.12, 0.01);
  EXPECT_NEAR(value_of(law("keller").modulus_MPa, kRho), 85.987, 0.005);
}

TEST(BoneStrength, NeverNegative) {
  EXPECT_EQ(value_of(*law("kopperdahl-linear").strength_MPa, 0.03), 0);  // root at 0.0301
  EXPECT_GT(value_of(*law("kopperdahl-linear").strength_MPa, 0.031), 0);
  for (const BoneLaw& each : bone_laws()) {
    EXPECT_EQ(value_of(each.modulus_MPa, 0), 0) << each.name;
    EXPECT_EQ(value_of(each.modulus_MPa, -1), 0) << each.name;
  }
}

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

// The forces of the procedures' tools in bone of the published densities, against the published forces.

struct Forces {
  double tip_N = 0, shaft_N_per_m = 0;
};

/// In uniform bone of a QCT density in g/cm^3, as a scene makes them.
Forces forces_of(std::string_view name, Strength strength, double density) {
  Scene scene = test::body_scene(0, 9, 0.12);
  scene.hand.trajectory.front().tip_m = {0, 0, 0.5};
  EXPECT_TRUE(apply_procedure(*find_procedure(name), strength, scene));
  EXPECT_TRUE(resolve_layers(scene));
  const double hu = density / BoneByHu{}.per_HU;
  const BoneVolume bone =
      test::bone_volume_of(scene, test::spaced_asset(10, 1, std::vector<double>(10, hu)));
  return {bone.sheets[3].strength_N(bone.shape, hu),
          bone.slabs[bone.sheets[3].first_slab].friction_N_per_m};
}

// Abstract of CORS 2013-220: 90 N, SD assumed 35 %; bone of a volume fraction of 0.209.
TEST(ProcedureForces, APedicleProbeNeedsThePublishedForce) {
  const double density = 0.598 * 1.9 * 0.209;
  const double N = forces_of("pedicle-probe", Strength::kMedian, density).tip_N;
  EXPECT_GT(N, 58.5);
  EXPECT_LT(N, 121.5);
  EXPECT_LT(forces_of("pedicle-probe", Strength::kLow, density).tip_N, 58.5);
  EXPECT_GT(forces_of("pedicle-probe", Strength::kHigh, density).tip_N, 121.5);
}

// Mulligan et al. 2010: 1,000 N, SD assumed 35 %, 25 mm deep, in bone of 0.30 g/cm^3. The friction's factor was fitted on it.
TEST(ProcedureForces, AJamshidiNeedleNeedsThePublishedForce) {
  const Forces forces = forces_of("jamshidi-8g", Strength::kMedian, 0.3);
  const double N = forces.tip_N + 0.025 * forces.shaft_N_per_m;
  EXPECT_GT(N, 650);
  EXPECT_LT(N, 1350);
}

// A needle through the back: each layer gives a few newtons, and the ligamentum flavum more than the dura.
TEST(ProcedureForces, TheLayersOfTheBackBreakInTheOrderOfTheirToughness) {
  for (const char* name : {"spinal-needle", "tuohy-needle"}) {
    double before_N = 0;
    for (const Strength strength : {Strength::kLow, Strength::kMedian, Strength::kHigh}) {
      Scene scene = test::body_scene(0, 9, 0.12);
      scene.hand.trajectory.front().tip_m = {0, 0, 0.5};
      ASSERT_TRUE(apply_procedure(*find_procedure(name), strength, scene));
      ASSERT_TRUE(resolve_layers(scene));
      ASSERT_EQ(scene.layers.size(), 5U);
      for (const SceneLayer& layer : scene.layers) {
        EXPECT_GT(layer.puncture_N, 0.1) << name << ", " << layer.name;
        EXPECT_LT(layer.puncture_N, 25) << name << ", " << layer.name;
        EXPECT_NEAR(layer.cutting_N, 0.61 * layer.puncture_N, 1e-9);
      }
      EXPECT_GT(scene.layers[3].puncture_N, scene.layers[4].puncture_N);
      EXPECT_GT(scene.layers[3].puncture_N, before_N);
      before_N = scene.layers[3].puncture_N;
    }
  }
}

}  // namespace
}  // namespace trocar::runtime
