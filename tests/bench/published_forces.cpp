// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/published_forces.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <numbers>
#include <random>
#include <stdexcept>

#include "runtime/haptics/bone/bone_volume.h"

namespace trocar::test {
namespace {

using namespace trocar::runtime;
using nlohmann::json;

constexpr int kDraws = 8001;
constexpr double kSolid_g_per_cm3 = 1.9;  // apparent density of bone without pores

/// Draws the inputs of one row. The same seed gives the same values on every machine with the same libm.
class Inputs {
 public:
  explicit Inputs(const json& model) : model_(model) {}

  double draw(const char* name) { return draw(model_.at(name)); }
  double draw(const char* name, double otherwise) {
    return model_.contains(name) ? draw(name) : otherwise;
  }
  double draw(const json& input) {
    if (input.is_number()) return input.get<double>();
    const std::pair<std::string, json> made = only(input);
    const std::string& name = made.first;
    const json& numbers = made.second;
    const double least = input.value("least", 0.0);
    const auto at = [&](std::size_t i) { return numbers.at(i).get<double>(); };
    if (name == "uniform") return at(0) + (at(1) - at(0)) * uniform();
    if (name == "normal") return std::max(at(0) + at(1) * normal(), least);
    if (name == "lognormal") return at(0) * std::exp(at(1) * normal());
    if (name == "span")
      return std::sqrt(at(0) * at(1)) * std::exp(std::log(at(1) / at(0)) / 2 / 1.645 * normal());
    if (name == "quartiles")
      return at(0) * std::exp(std::log(at(2) / at(1)) / 2 / 0.6745 * normal());
    throw std::invalid_argument("no distribution is called " + name);
  }

 private:
  static std::pair<std::string, json> only(const json& input) {
    for (const auto& [name, value] : input.items())
      if (name != "least") return {name, value};
    throw std::invalid_argument("an input has no distribution");
  }
  double uniform() { return (static_cast<double>(random_() >> 11) + 0.5) * 0x1p-53; }
  double normal() {
    const double radius = std::sqrt(-2 * std::log(uniform()));
    return radius * std::cos(2 * std::numbers::pi * uniform());
  }

  const json& model_;
  std::mt19937_64 random_{7};
};

double density(Inputs& in, const json& model) {
  if (model.contains("density_g_per_cm3")) return in.draw("density_g_per_cm3");
  // QCT density is about the ash density.
  const double apparent = kSolid_g_per_cm3 * in.draw("bone_volume_fraction");
  return kAshOverApparent * apparent;
}

/// Pressure under a flat tip.
double pressure_Pa(Inputs& in, const json& model) {
  const BoneLaw& law = *find_bone_law("kopperdahl-power");
  const double yield_MPa = value_of(*law.strength_MPa, density(in, model));
  const double over_yield = in.draw("pressure_over_yield");
  return 1e6 * over_yield * yield_MPa * in.draw("scatter", 1);
}

double tip_N(Inputs& in, const json& model) {
  const double pressure = pressure_Pa(in, model);
  const double friction = in.draw("friction"), diameter_mm = in.draw("diameter_mm");
  const ToolShape cone{.kind = ToolKind::kNeedleConical,
                       .outer_radius_m = diameter_mm * 0.5e-3,
                       .inner_radius_m = 0,
                       .half_angle_rad = in.draw("half_angle_deg") * std::numbers::pi / 180};
  const CutMaterial bone{.strength_Pa = pressure, .face_friction = friction};
  return tool_in_tissue(cone, bone, 1, in.draw("twist")).strength_N;
}

double wall_N(Inputs& in, const json& wall) {
  const auto draw = [&](const char* name) { return in.draw(wall.at(name)); };
  const double dense_Pa = cortex_flow_Pa(draw("apparent_g_per_cm3"));
  const double flow_Pa = dense_Pa * draw("flow_factor");
  const double thickness_m = 1e-3 * draw("thickness_mm"), tip_m = 1e-3 * draw("tip_radius_mm");
  const double free_radius_m = 1e-3 * draw("free_radius_mm"), shear_Pa = 1e6 * draw("shear_MPa");
  return break_N({.thickness_m = thickness_m,
                  .free_radius_m = free_radius_m,
                  .flow_Pa = flow_Pa,
                  .shear_Pa = shear_Pa,
                  .clamping = draw("clamping")},
                 tip_m);
}

struct Shaft {
  double edge_N = 0, friction_N = 0;
};
/// A hollow tool with a flat edge, at its depth.
Shaft shaft_at_depth(Inputs& in, const json& model, WallPressure wall_pressure) {
  // Draws are statements of their own, because the order within an expression is not specified.
  const double pressure = pressure_Pa(in, model), friction = in.draw("friction");
  const double outer_mm = in.draw("outer_mm"), bore_mm = in.draw("bore_mm");
  const double xi = in.draw("twist"), depth_m = 1e-3 * in.draw("depth_mm");
  const ToolShape tool{.kind = ToolKind::kJamshidi,
                       .outer_radius_m = outer_mm * 0.5e-3,
                       .inner_radius_m = bore_mm * 0.5e-3,
                       .half_angle_rad = std::numbers::pi / 2};
  const CutMaterial bone{.strength_Pa = pressure,
                         .friction_Pa = friction * wall_pressure * pressure};
  const ToolInTissue at = tool_in_tissue(tool, bone);
  return {at.strength_N, at.friction_N_per_m * depth_m / std::sqrt(1 + xi * xi)};
}

double tear_N(Inputs& in, const json& model) {
  const auto kind = find_tool_kind(model.at("tip").get<std::string>());
  if (!kind) throw std::invalid_argument("no tip is called " + model.at("tip").dump());
  const double toughness = in.draw("toughness_J_per_m2"),
               thickness_m = 1e-3 * in.draw("thickness_mm");
  const ToolShape tool{.kind = *kind,
                       .outer_radius_m = in.draw("diameter_mm") * 0.5e-3,
                       .inner_radius_m = 0,
                       .half_angle_rad = in.draw("half_angle_deg") * std::numbers::pi / 180};
  return membrane_break_N(toughness, thickness_m, tool);
}

double predict_once(Inputs& in, const json& model, WallPressure wall_pressure) {
  const auto kind = model.at("kind").get<std::string>();
  if (kind == "tip") return tip_N(in, model);
  if (kind == "wall") return wall_N(in, model);
  if (kind == "tip_and_wall") {
    const double tip = tip_N(in, model);
    return tip + wall_N(in, model.at("wall"));
  }
  if (kind == "strength") return 1e-6 * pressure_Pa(in, model);
  if (kind == "tear") return tear_N(in, model);
  const Shaft shaft = shaft_at_depth(in, model, wall_pressure);
  if (kind == "shaft") return shaft.edge_N + shaft.friction_N;
  if (kind == "shaft_or_wall")
    return shaft.edge_N + std::max(shaft.friction_N, wall_N(in, model.at("wall")));
  // Over an insertion the friction grows from 0 to that at the depth.
  if (kind == "friction_fraction")
    return 0.5 * shaft.friction_N / (shaft.edge_N + 0.5 * shaft.friction_N);
  throw std::invalid_argument("no kind of prediction is called " + kind);
}

double ratio(const PublishedForce& row, const Prediction& prediction) {
  return prediction.median / row.mean;
}

}  // namespace

std::vector<PublishedForce> read_published_forces(const std::filesystem::path& file) {
  std::ifstream stream(file);
  if (!stream) throw std::runtime_error(file.string() + ": cannot be read");
  const json document = json::parse(stream);
  std::vector<PublishedForce> rows;
  for (const json& each : document.at("rows")) {
    PublishedForce row;
    for (const auto& [key, text] :
         {std::pair("id", &row.id), std::pair("study", &row.study),
          std::pair("mechanism", &row.mechanism), std::pair("tool", &row.tool),
          std::pair("specimen", &row.specimen), std::pair("unit", &row.unit),
          std::pair("spread", &row.spread), std::pair("source", &row.source),
          std::pair("evidence", &row.evidence), std::pair("assumed", &row.assumed),
          std::pair("miss", &row.miss)})
      *text = each.at(key).get<std::string>();
    const auto standing = each.at("standing").get<std::string>();
    row.standing = standing == "counted"  ? Standing::kCounted
                   : standing == "fitted" ? Standing::kFitted
                   : standing == "shown"
                       ? Standing::kShown
                       : throw std::runtime_error("no standing is called " + standing);
    row.mean = each.at("mean").get<double>();
    row.low = each.at("low").get<double>();
    row.high = each.at("high").get<double>();
    row.is_at_least = each.at("at_least").get<bool>();
    row.model = each.at("model");
    rows.push_back(std::move(row));
  }
  return rows;
}

Prediction predict(const PublishedForce& row, WallPressure wall_pressure) {
  Inputs in(row.model);
  std::vector<double> values(kDraws);
  for (double& value : values)
    value = predict_once(in, row.model, wall_pressure);
  std::sort(values.begin(), values.end());
  const auto at = [&](double part) {
    return values[static_cast<std::size_t>(std::lround(part * (kDraws - 1)))];
  };
  return {at(0.05), at(0.5), at(0.95)};
}

WallPressure fit(const std::vector<PublishedForce>& rows) {
  const PublishedForce* fitted = nullptr;
  for (const PublishedForce& row : rows) {
    if (row.standing != Standing::kFitted) continue;
    if (fitted != nullptr) throw std::invalid_argument("two rows are fitted");
    fitted = &row;
  }
  if (fitted == nullptr) throw std::invalid_argument("no row is fitted");
  double low = 0.01, high = 4;
  for (int k = 0; k < 30; ++k) {
    const double middle = 0.5 * (low + high);
    (predict(*fitted, middle).median < fitted->mean ? low : high) = middle;
  }
  return 0.5 * (low + high);
}

bool is_hit(const PublishedForce& row, const Prediction& prediction) {
  if (row.is_at_least) return prediction.median >= row.low;
  const double times = ratio(row, prediction);
  return prediction.high >= row.low && prediction.low <= row.high && times <= 1.5 &&
         times >= 1 / 1.5;
}

}  // namespace trocar::test
