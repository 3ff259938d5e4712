// SPDX-License-Identifier: Apache-2.0
#include "runtime/calibration/fitted_tissue.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "runtime/bone_cutting/material/bone_volume.h"
#include "runtime/calibration/fit_page.h"
#include "tests/runtime/calibration/synthetic_curve.h"

namespace trocar::runtime {
namespace {

CurveFit some_fit(double layer_N = 0) {
  SyntheticTissue tissue;
  tissue.layer_N = layer_N;
  tissue.layer_mm = layer_N > 0 ? 1 : 0;
  SyntheticMachine machine;
  machine.withdraws = true;
  std::mt19937_64 random(5);
  const Result<CurveFit> fit = fit_curve(synthetic_curve(tissue, machine, random), 3);
  EXPECT_TRUE(fit);
  return fit ? *fit : CurveFit{};
}

Result<Scene> scene_with(const std::string& tissue) {
  return parse_scene(R"({"schema": "trocar.scene/1", "name": "s", "asset": "a.glb", "duration_s": 1,
    "slices": [{"index": 0, "z_m": 0}], "hand": {"trajectory": [{"t_s": 0, "tip_m": [0, 0, 0]}]},
    "tissue": )" + tissue +
                         "}",
                     "scene.json", ".");
}

TEST(FittedTissue, GivesTheFitBackInAScene) {
  const CurveFit fit = some_fit();
  SceneTool tool;
  tool.kind = "needle-conical";
  tool.radius_m = 1.5e-3;
  tool.sides = 6;
  const Result<std::string> text = fitted_tissue(fit, tool);
  ASSERT_TRUE(text) << text.error().message;
  const Result<Scene> scene = scene_with(*text);
  ASSERT_TRUE(scene) << scene.error().message;
  const CutTissue& cut = *scene->tissue.cut;
  const Result<ToolShape> shape = tool_shape(tool);
  ASSERT_TRUE(shape);
  CutMaterial material;
  material.strength_Pa = *cut.strength_MPa * 1e6;
  material.modulus_Pa = cut.modulus_MPa * 1e6;
  material.friction_Pa = cut.friction_kPa * 1e3;
  const ToolInTissue in = tool_in_tissue(*shape, material);
  EXPECT_NEAR(in.strength_N, fit.cutting_N.value, 1e-3 * fit.cutting_N.value);
  EXPECT_NEAR(in.tip_N_per_m, 1e3 * fit.stiffness_N_per_mm.value, fit.stiffness_N_per_mm.value);
  // A hexagon's circumference is longer than that of the disc of its area by 5 %, which the scene multiplies.
  EXPECT_NEAR(in.friction_N_per_m * 1.0501, 1e3 * fit.friction_N_per_mm.value,
              2 * fit.friction_N_per_mm.value);
}

TEST(FittedTissue, OutOfAScenesRange) {
  CurveFit fit = some_fit();
  fit.cutting_N.value = 5000;
  const Result<std::string> text = fitted_tissue(fit, SceneTool{});
  ASSERT_FALSE(text);
  EXPECT_EQ(text.error().code, ExitCode::kRefused);
  EXPECT_NE(text.error().message.find("threshold_N"), std::string::npos) << text.error().message;
}

TEST(FittedTissue, ShellOfAHardLayer) {
  EXPECT_EQ(fitted_shell(some_fit()), "");
  const std::string shell = fitted_shell(some_fit(150));
  EXPECT_TRUE(shell.starts_with("{ \"thickness_m\": 0.00")) << shell;
}

TEST(FittedTissue, ToolFromAFile) {
  const std::filesystem::path file =
      std::filesystem::temp_directory_path() / "trocar_fitted_tissue_tool.json";
  const auto write = [&](const char* text) { std::ofstream(file) << text; };
  write(R"({"kind": "trocar", "radius_m": 0.002})");
  const Result<SceneTool> tool = read_fit_tool(file);
  ASSERT_TRUE(tool) << tool.error().message;
  EXPECT_EQ(tool->kind, "trocar");
  for (const char* wrong :
       {"", "[]", "{\"radius\": 1}", "{\"kind\": \"spoon\"}", "{\"radius_m\": -1}"}) {
    write(wrong);
    const Result<SceneTool> refused_tool = read_fit_tool(file);
    ASSERT_FALSE(refused_tool) << wrong;
    EXPECT_EQ(refused_tool.error().code, ExitCode::kRefused) << wrong;
  }
  std::filesystem::remove(file);
}

TEST(FitPage, IsSelfContainedAndEscaped) {
  const std::string page = fit_page(some_fit(150), "<script>.csv", "{}\n");
  EXPECT_EQ(page.find("<script"), std::string::npos);
  EXPECT_EQ(page.find("http"), std::string::npos);
  EXPECT_EQ(page.find("nan"), std::string::npos);
  EXPECT_NE(page.find("<svg"), std::string::npos);
  EXPECT_NE(fit_text(some_fit(150)).find("thickness of the hard layer"), std::string::npos);
}

}  // namespace
}  // namespace trocar::runtime
