// SPDX-License-Identifier: Apache-2.0
#include "runtime/calibration/fitted_tissue.h"

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <numbers>

#include "formats/base/file_io.h"
#include "formats/base/json_text.h"
#include "formats/base/strict_json.h"
#include "formats/base/text_line.h"
#include "runtime/bone_cutting/material/bone_volume.h"
#include "runtime/bone_cutting/material/tool_in_tissue.h"
#include "runtime/contact/tool.h"

namespace trocar::runtime {
namespace {

using Json = nlohmann::ordered_json;  // ordered, because people read scenes

constexpr double kPoisson = 0.3;  // that of CutMaterial
constexpr std::uint64_t kMaxToolBytes = std::uint64_t{1} << 20;

/// Five significant digits, which is more than a fit knows.
double rounded(double value) {
  return std::strtod(text_line("%.5g", value).c_str(), nullptr);
}

/// A scene with nothing but what is to be checked.
Result<Scene> parse_part(const char* key, const nlohmann::json& part, const std::string& name) {
  const nlohmann::json scene = {{"schema", kSceneSchema},
                                {"name", "fit"},
                                {"asset", "fit.glb"},
                                {"duration_s", 1},
                                {"slices", {{{"index", 0}, {"z_m", 0}}}},
                                {"hand", {{"trajectory", {{{"t_s", 0}, {"tip_m", {0, 0, 0}}}}}}},
                                {key, part}};
  return parse_scene(json_text(scene), name, ".");
}

/// The length of the tool's outline over that of the disc of its area (bone_volume.cpp).
double outline_share(const SceneTool& tool, const ToolShape& shape) {
  const Tool made = make_tool(tool);
  double outline_m = 0;
  for (int i = 0; i < made.sides; ++i)
    outline_m += (made.corner_plate_m.at((i + 1) % made.sides) - made.corner_plate_m.at(i)).norm();
  return outline_m / (2 * std::numbers::pi * shape.outer_radius_m);
}

}  // namespace

Result<SceneTool> read_fit_tool(const std::filesystem::path& file) {
  const Result<std::vector<std::uint8_t>> bytes = read_file(file, kMaxToolBytes);
  if (!bytes) return bytes.error();
  const std::string_view text(reinterpret_cast<const char*>(bytes->data()), bytes->size());
  const Result<nlohmann::json> parsed = parse_strict_json(text, file.string());
  if (!parsed) return parsed.error();
  if (!parsed->is_object())
    return refused(file.string() + ": must be an object, a scene or its tool");
  const bool is_scene = parsed->contains("schema");
  const Result<Scene> scene = is_scene ? parse_scene(text, file.string(), file.parent_path())
                                       : parse_part("tool", *parsed, file.string());
  if (!scene) return scene.error();
  if (const Result<ToolShape> shape = tool_shape(scene->tool); !shape)
    return refused(file.string() + ": " + shape.error().message);
  return scene->tool;
}

Result<std::string> fitted_tissue(const CurveFit& fit, const SceneTool& tool) {
  const Result<ToolShape> shape = tool_shape(tool);
  if (!shape) return shape.error();
  // The law's values for a tissue with one pascal of everything.
  CutMaterial unit;
  unit.strength_Pa = 1;
  unit.modulus_Pa = 1;
  unit.friction_Pa = outline_share(tool, *shape);
  unit.poisson = kPoisson;
  const ToolInTissue in = tool_in_tissue(*shape, unit);
  const double stiffness_N_per_m = fit.stiffness_N_per_mm.value * 1e3;
  Json cut;
  cut["strength_MPa"] = rounded(fit.cutting_N.value / in.strength_N * 1e-6);
  cut["modulus_MPa"] = rounded(stiffness_N_per_m / in.tip_N_per_m * 1e-6);
  cut["friction_kPa"] = rounded(fit.friction_N_per_mm.value * 1e3 / in.friction_N_per_m * 1e-3);
  Json tissue;
  tissue["stiffness_N_per_m"] = rounded(stiffness_N_per_m);
  tissue["threshold_N"] = rounded(fit.cutting_N.value);
  tissue["cut"] = cut;
  const Result<Scene> scene = parse_part("tissue", nlohmann::json(tissue), "the fitted tissue");
  if (!scene) return scene.error();
  return json_text(tissue, 2) + "\n";
}

std::string fitted_shell(const CurveFit& fit) {
  if (!fit.layer_N || !fit.layer_mm) return {};
  const double thickness_m = fit.layer_mm->value * 1e-3,
               factor = fit.layer_N->value / fit.cutting_N.value;
  if (!(thickness_m >= 1e-4 && thickness_m <= 0.01 && factor >= 0.1 && factor <= 100)) return {};
  return text_line(R"({ "thickness_m": %.4g, "strength_factor": %.4g })", thickness_m, factor);
}

}  // namespace trocar::runtime
