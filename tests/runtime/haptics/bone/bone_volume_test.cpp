// SPDX-License-Identifier: Apache-2.0
// The slabs of a body from its sheets: extents, what tissues oppose by hand-computed figures, parts
// for a shell, and what is refused.
#include "runtime/haptics/bone/bone_volume.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>

#include "tests/support/body_fixture.h"

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

TEST(BoneVolume, SlabsReachHalfWayToTheirNeighbours) {
  const BoneVolume body = bone_volume_of(cutting_scene({0.12, 0.119, 0.1176}), square_asset(3));
  expect_ordered(body);
  ASSERT_EQ(body.slabs.size(), 3U);
  expect_extent(body.sheets[0], -0.1205, -0.1195);
  expect_extent(body.sheets[1], -0.1195, -0.1183);
  expect_extent(body.sheets[2], -0.1183, -0.1169);
  EXPECT_FALSE(body.sheets[0].meets_above);
  EXPECT_FALSE(body.sheets[2].meets_below);
  for (const CuttingSlab& slab : body.slabs)
    EXPECT_EQ(slab.hole_m, 0);
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
  scene.tissue.cut.emplace();
  scene.tissue.cut->bone = BoneByHu{"kopperdahl-linear", "qct", 8e-4, 0, false};
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

TEST(BoneVolume, AShellHasTheStrengthUnderTheToolTimesItsFactor) {
  Scene scene = body_scene(0, 2, 0.12);
  scene.body->shell_m = 1e-3;
  scene.body->shell_factor = 3;
  EXPECT_EQ(bone_volume_of(scene, square_asset(3)).sheets[0].shell_factor, 3);
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

// The shaft's friction follows the strength of the bone under the tool, as far as the friction
// coefficient makes it, and is the nominal one at the slice's mean HU.
TEST(BoneVolume, FrictionFollowsTheStrengthUnderTheTool) {
  Scene scene = cutting_scene(stack(0.12, 1e-3, 3));
  scene.tissue.cut.emplace();
  scene.tissue.cut->bone = BoneByHu{"kopperdahl-linear", "qct", 8e-4, 0, false};
  scene.tissue.cut->friction_kPa = 20;
  scene.tissue.cut->friction_coefficient = 0.05;
  const BoneVolume body = bone_volume_of(scene, spaced_asset(3, 1, {200, 400, 20}));
  constexpr double kOutline_m = 18e-3;
  const auto friction = [&](double hu) {
    const double strength_Pa = std::max(0.16, -0.75 + 24.9 * 8e-4 * hu) * 1e6;
    return (20e3 + 0.05 * strength_Pa) * kOutline_m;
  };
  for (std::size_t i = 0; i < 3; ++i) {
    const double nominal = body.slabs[i].friction_N_per_m;
    EXPECT_NEAR(nominal, friction((std::array{200.0, 400.0, 20.0})[i]), 1e-6) << i;
    for (const double hu : {-100.0, 150.0, 900.0})
      EXPECT_NEAR(body.sheets[i].friction_N_per_m(hu, nominal), friction(hu), 1e-6) << i << hu;
  }
  scene.tissue.cut->friction_coefficient = 0;
  const BoneVolume constant = bone_volume_of(scene, spaced_asset(3, 1, {200, 400, 20}));
  EXPECT_EQ(constant.sheets[0].friction_N_per_m(900, 360), 360) << "20 kPa alone";
}

// A tissue that states no stiffness has a tip as stiff as its bone; one that states it keeps it.
TEST(BoneVolume, TheTipsStiffnessIsTheBonesUnlessItIsStated) {
  Scene scene = cutting_scene(stack(0.12, 1e-3, 3));
  scene.tissue.cut.emplace();
  scene.tissue.cut->bone = BoneByHu{"kopperdahl-linear", "qct", 8e-4, 0, false};
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

}  // namespace
}  // namespace trocar::runtime
