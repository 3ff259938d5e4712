// SPDX-License-Identifier: Apache-2.0
// The procedures: their ranges are those of the distributions that they name, and scenes take them.
#include "formats/session/procedures.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <string>
#include <vector>

namespace trocar {
namespace {

/// The 5th, 50th and 95th percentile of `draw`.
template <typename Draw>
Range range_of(Draw draw) {
  std::mt19937_64 random(1);
  std::vector<double> values(200'001);
  for (double& value : values)
    value = draw(random);
  std::sort(values.begin(), values.end());
  return {values[10'000], values[100'000], values[190'000], ""};
}

void expect_near(const Range& got, const Range& wanted, const char* what) {
  EXPECT_NEAR(got.low, wanted.low, 0.02 * wanted.low) << what;
  EXPECT_NEAR(got.median, wanted.median, 0.02 * wanted.median) << what;
  EXPECT_NEAR(got.high, wanted.high, 0.02 * wanted.high) << what;
}

TEST(Procedures, RangesAreThoseOfTheDistributionsThatTheyName) {
  const Range pressure = range_of([](auto& random) {
    return std::uniform_real_distribution<double>(1, 1.3)(random) *
           std::exp(std::normal_distribution<double>(0, 0.3)(random));
  });
  const Range friction = range_of(
      [](auto& random) { return 0.47 * std::uniform_real_distribution<double>(0.2, 0.4)(random); });
  const Range flavum =
      range_of([](auto& random) { return std::normal_distribution<double>(3.38, 0.94)(random); });
  for (const Procedure& each : procedures()) {
    expect_near(each.bone.pressure_over_yield, pressure, "pressure");
    expect_near(each.bone.friction_coefficient, friction, "friction");
    for (const ProcedureLayer& layer : each.layers)
      if (layer.name == "ligamentum flavum") expect_near(layer.thickness_mm, flavum, "flavum");
  }
}

TEST(Procedures, EachValueHasARangeInOrderAndASource) {
  const auto check = [](const Range& range, const std::string& what) {
    EXPECT_LE(range.low, range.median) << what;
    EXPECT_LE(range.median, range.high) << what;
    EXPECT_FALSE(range.source.empty()) << what;
  };
  EXPECT_EQ(procedures().size(), 6U);
  for (const Procedure& each : procedures()) {
    const std::string name(each.name);
    check(each.diameter_mm, name);
    check(each.bone.tearing_N_per_m, name);
    check(each.bone.foundation_N_per_mm3, name);
    check(each.bone.lateral_strength_MPa, name);
    double depth_mm = 0;
    for (const ProcedureLayer& layer : each.layers) {
      const std::string what = name + ", " + std::string(layer.name);
      check(layer.thickness_mm, what);
      check(layer.toughness_J_per_m2, what);
      check(layer.stiffness_N_per_m, what);
      check(layer.stiffening_N_per_m2, what);
      check(layer.friction_N_per_m, what);
      if (layer.name != "dura") depth_mm += layer.thickness_mm.median + layer.gap_mm;
    }
    if (!each.layers.empty() && each.layers.back().name == "dura") {
      EXPECT_NEAR(depth_mm, 55.4, 0.5) << "skin to subarachnoid space";
    }
    EXPECT_EQ(find_procedure(each.name), &each);
    const std::string text = explain(each);
    EXPECT_NE(text.find(each.title), std::string::npos);
    EXPECT_NE(text.find(each.bone.pressure_over_yield.source), std::string::npos);
  }
  EXPECT_EQ(find_procedure("spoon"), nullptr);
  EXPECT_EQ(strength_from_string("weak"), std::nullopt);
}

std::string scene_text(const std::string& more, double z_m = 0.23) {
  return R"({"schema": "trocar.scene/1", "name": "n", "asset": "a.glb", "duration_s": 1,
    "body": {"from": 0, "to": 9, "top_z_m": 0.15},
    "hand": {"trajectory": [{"t_s": 0, "tip_m": [0, 0, )" +
         std::to_string(z_m) + "]}]}" + more + "}";
}

std::string error_of(const std::string& text) {
  const Result<Scene> scene = parse_scene(text, "s", ".");
  return scene ? std::string() : scene.error().message;
}

TEST(Procedures, ASceneTakesToolTissueAndLayers) {
  for (const Procedure& each : procedures()) {
    const Result<Scene> scene =
        parse_scene(scene_text(R"(, "tool": {"tilt_deg": 10}, "procedure": {"name": ")" +
                               std::string(each.name) + R"(", "strength": "high"})"),
                    "s", ".");
    ASSERT_TRUE(scene) << scene.error().message;
    EXPECT_EQ(scene->force_law.kind, ForceLawKind::kCutting);
    EXPECT_EQ(scene->tool.kind, each.kind);
    EXPECT_EQ(scene->tool.tilt_deg, 10);
    EXPECT_DOUBLE_EQ(scene->tool.radius_m, 0.5e-3 * each.diameter_mm.high);
    ASSERT_TRUE(scene->tissue.cut);
    EXPECT_EQ(scene->tissue.cut->pressure_over_yield, each.bone.pressure_over_yield.high);
    ASSERT_EQ(scene->layers.size(), each.layers.size());
    double above_m = 1;
    for (const SceneLayer& layer : scene->layers) {
      EXPECT_LE(layer.top_z_m, above_m + 1e-12);
      above_m = layer.top_z_m - layer.thickness_m;
    }
    if (!scene->layers.empty()) {
      EXPECT_NEAR(above_m, 0.15, 1e-12) << "on the bone";
    }
  }
}

TEST(Procedures, ASceneThatStatesTheSameIsRefused) {
  const std::string procedure = R"(, "procedure": {"name": "spinal-needle"})";
  EXPECT_EQ(error_of(scene_text(procedure)), "");
  EXPECT_NE(error_of(scene_text(procedure, 0.16)).find("/procedure: the hand begins at z 0.16 m"),
            std::string::npos);
  EXPECT_NE(error_of(scene_text(R"(, "tissue": {})" + procedure)).find("/tissue: cannot"),
            std::string::npos);
  EXPECT_NE(error_of(scene_text(R"(, "tool": {"sides": 8})" + procedure)).find("/tool/sides"),
            std::string::npos);
  EXPECT_NE(error_of(scene_text(R"(, "procedure": {"name": "spoon"})")).find("must be one of"),
            std::string::npos);
  EXPECT_NE(error_of(scene_text(R"(, "procedure": {"name": "jamshidi-8g", "strength": "x"})"))
                .find("/procedure/strength"),
            std::string::npos);
}

}  // namespace
}  // namespace trocar
