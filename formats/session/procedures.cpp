// SPDX-License-Identifier: Apache-2.0
#include "formats/session/procedures.h"

#include <algorithm>

#include "formats/base/text.h"

namespace trocar {
namespace {

constexpr Range one(double value, std::string_view source) {
  return {value, value, value, source};
}

// Bone. The ranges of products are those of the distributions that the sources give
// (procedures_test.cpp computes them again).
constexpr ProcedureBone kBone{
    .pressure_over_yield = {0.69, 1.15, 1.90,
                            "1.0 to 1.3 (Ashby et al., Metal Foams, 2000, chapter 3.9) times the "
                            "scatter of the strength law (assumed: log SD 0.30)"},
    .tearing_N_per_m = {250, 500, 1000, "assumed: work of tearing trabeculae per crack"},
    .friction_coefficient = {0.099, 0.141, 0.183,
                             "0.2 to 0.4 (assumed) times 0.47, the part of the pressure that acts "
                             "on the shaft (fitted on Mulligan et al., Mater. Sci. Forum 654-656, "
                             "2010, Jamshidi 8 G)"},
    .foundation_N_per_mm3 = {30, 50, 100, "assumed: modulus over diameter of cancellous bone"},
    .lateral_strength_MPa = {2, 5, 9, "assumed: the compressive strength of cancellous bone"}};

// Soft tissue.
constexpr std::string_view kMembranes =
    "assumed: the toughness of other membranes, 0.96 to 2.5 kJ/m^2";
constexpr Range kSkinToughness{800, 1140, 1600,
                               "1.14 kJ/m^2 for needles (Chin. J. Mech. Eng., 2022, "
                               "10.1186/s10033-022-00767-4); spread assumed"};
constexpr Range kMuscleToughness{550, 2000, 8000,
                                 "0.55 to 8 kJ/m^2 (Chin. J. Mech. Eng., 2022, "
                                 "10.1186/s10033-022-00767-4); median assumed"};
constexpr Range kFatToughness{200, 500, 1000, "assumed"};
constexpr Range kMembraneToughness{960, 1550, 2500, kMembranes};
constexpr std::string_view kAssumed = "assumed";

constexpr std::array kSpine{
    ProcedureLayer{"skin",
                   {1.5, 2, 2.5, kAssumed},
                   kSkinToughness,
                   {200, 300, 400, kAssumed},
                   {5e4, 1e5, 2e5, kAssumed},
                   {10, 30, 60, kAssumed}},
    ProcedureLayer{"fat",
                   {8, 12, 16, kAssumed},
                   kFatToughness,
                   {50, 100, 200, kAssumed},
                   {5e3, 1e4, 2e4, kAssumed},
                   {5, 15, 30, kAssumed}},
    ProcedureLayer{"muscle and interspinous ligament",
                   {28.3, 33.7, 39.1,
                    "skin to subarachnoid space at L3-L4 55.4 mm, SD 6.5 (J. Health Sci. 7:23, "
                    "2017), less the other layers"},
                   kMuscleToughness,
                   {150, 300, 600, kAssumed},
                   {2e4, 5e4, 1e5, kAssumed},
                   {20, 50, 100, kAssumed}},
    ProcedureLayer{"ligamentum flavum",
                   {1.8, 3.4, 4.9, "3.38 mm, SD 0.94 at L3-L4 (Asian Spine J. 9:245, 2015)"},
                   kMembraneToughness,
                   {400, 800, 1600, kAssumed},
                   {5e4, 1e5, 2e5, kAssumed},
                   {20, 50, 100, kAssumed},
                   4},
    ProcedureLayer{"dura",
                   {0.25, 0.35, 0.45, kAssumed},
                   kMembraneToughness,
                   {100, 200, 400, kAssumed},
                   {2e4, 5e4, 1e5, kAssumed},
                   {2, 5, 10, kAssumed}},
};
// A vertebroplasty needle reaches the pedicle beside the ligaments.
constexpr std::span<const ProcedureLayer> kBack = std::span(kSpine).first(3);

constexpr std::array kProcedures{
    Procedure{
        .name = "pedicle-probe",
        .title = "awl or probe into a pedicle, open surgery",
        .kind = "needle-conical",
        .diameter_mm = one(3.4, "assumed: awls of 3.0 to 3.8 mm (CORS 2013-220 does not say)"),
        .half_angle_deg = one(16, "assumed: 12 to 20 degrees"),
        .bone = kBone,
        .twists = true},
    Procedure{.name = "jamshidi-8g",
              .title = "bone biopsy needle of 8 G, stylet out",
              .kind = "jamshidi",
              .diameter_mm = one(4.0, "Mulligan et al., Mater. Sci. Forum 654-656, 2010"),
              .bore_mm = one(3.2, "assumed"),
              .half_angle_deg = one(90, ""),
              .bone = kBone,
              .twists = true},
    Procedure{.name = "vertebroplasty-11g",
              .title = "needle of 11 G with its stylet, through skin and muscle into a pedicle",
              .kind = "needle-diamond",
              .diameter_mm = one(3.05, "11 G, ISO 9626"),
              .half_angle_deg = one(25, "assumed"),
              .bone = kBone,
              .twists = true,
              .layers = kBack},
    Procedure{.name = "bone-marrow-trephine",
              .title = "trephine of 8 G for a core of bone marrow, twisted by hand",
              .kind = "jamshidi",
              .diameter_mm = one(4.19, "8 G, ISO 9626"),
              .bore_mm = one(3.2, "assumed"),
              .half_angle_deg = one(90, ""),
              .bone = kBone,
              .twists = true},
    Procedure{.name = "spinal-needle",
              .title = "spinal needle of 22 G with a cutting bevel, through skin to the dura",
              .kind = "needle-bevel",
              .diameter_mm = one(0.72, "22 G, ISO 9626"),
              .half_angle_deg = one(20, "assumed"),
              .bone = kBone,
              .layers = kSpine},
    Procedure{.name = "tuohy-needle",
              .title = "epidural needle of 17 G, through skin to the dura",
              .kind = "needle-bevel",
              .diameter_mm = one(1.47, "17 G, ISO 9626"),
              .half_angle_deg = one(30, "assumed"),
              .bone = kBone,
              .layers = kSpine},
};

double top_of_bone_m(const Scene& scene) {
  if (scene.body) return scene.body->top_z_m;
  double top_m = -1;
  for (const SceneSlice& slice : scene.slices)
    top_m = std::max(top_m, slice.z_m);
  return top_m;
}

std::vector<SceneLayer> layers_of(const Procedure& procedure, Strength strength, double bone_m) {
  std::vector<SceneLayer> layers;
  double z_m = bone_m;
  for (const ProcedureLayer& each : procedure.layers)
    z_m += 1e-3 * (each.thickness_mm.at(strength) + each.gap_mm);
  for (const ProcedureLayer& each : procedure.layers) {
    SceneLayer& layer = layers.emplace_back();
    layer.name = each.name;
    layer.top_z_m = z_m;
    layer.thickness_m = 1e-3 * each.thickness_mm.at(strength);
    layer.toughness_J_per_m2 = each.toughness_J_per_m2.at(strength);
    layer.stiffness_N_per_m = each.stiffness_N_per_m.at(strength);
    layer.stiffening_N_per_m2 = each.stiffening_N_per_m2.at(strength);
    layer.friction_N_per_m = each.friction_N_per_m.at(strength);
    z_m -= layer.thickness_m + 1e-3 * each.gap_mm;
  }
  return layers;
}

std::string line(std::string_view what, const char* unit, const Range& range) {
  const std::string name(what), source(range.source);
  if (range.low == range.high)
    return text_line("  %-34s %10.4g %21s %-8s %s\n", name.c_str(), range.median, "", unit,
                     source.c_str());
  return text_line("  %-34s %10.4g %10.4g %10.4g %-8s %s\n", name.c_str(), range.median, range.low,
                   range.high, unit, source.c_str());
}

}  // namespace

const char* to_string(Strength strength) noexcept {
  constexpr const char* kNames[] = {"low", "median", "high"};
  return kNames[static_cast<int>(strength)];
}

std::optional<Strength> strength_from_string(std::string_view text) noexcept {
  for (const Strength each : {Strength::kLow, Strength::kMedian, Strength::kHigh})
    if (text == to_string(each)) return each;
  return std::nullopt;
}

std::span<const Procedure> procedures() noexcept {
  return kProcedures;
}

const Procedure* find_procedure(std::string_view name) noexcept {
  const auto* found = std::ranges::find(kProcedures, name, &Procedure::name);
  return found != kProcedures.end() ? found : nullptr;
}

std::string procedure_names() {
  std::string names;
  for (const Procedure& each : kProcedures)
    names += (names.empty() ? "" : ", ") + std::string(each.name);
  return names;
}

Result<void> apply_procedure(const Procedure& procedure, Strength strength, Scene& scene) {
  if (!scene.tissues.empty())
    return refused("has tissues of its own, which a procedure does not replace");
  std::vector<SceneLayer> layers = layers_of(procedure, strength, top_of_bone_m(scene));
  if (!layers.empty() && scene.hand.trajectory.front().tip_m[2] < layers.front().top_z_m)
    return refused(
        text_line("the hand begins at z %.4g m, within the layers of %s, whose skin is "
                  "at %.4g m: let it begin higher",
                  scene.hand.trajectory.front().tip_m[2], std::string(procedure.name).c_str(),
                  layers.front().top_z_m));
  SceneTool& tool = scene.tool;
  tool.outline_m.clear();
  tool.kind = procedure.kind;
  tool.sides = 12;
  tool.radius_m = 0.5e-3 * procedure.diameter_mm.at(strength);
  tool.inner_radius_m = 0.5e-3 * procedure.bore_mm.at(strength);
  tool.half_angle_deg = procedure.half_angle_deg.at(strength);
  Tissue& tissue = scene.tissue = Tissue{};
  scene.tissue_is_given = true;
  CutTissue& cut = tissue.cut.emplace();
  cut.bone.emplace().law = "kopperdahl-power";
  const ProcedureBone& bone = procedure.bone;
  cut.pressure_over_yield = bone.pressure_over_yield.at(strength);
  cut.tearing_N_per_m = bone.tearing_N_per_m.at(strength);
  cut.friction_coefficient = bone.friction_coefficient.at(strength);
  cut.foundation_N_per_mm3 = bone.foundation_N_per_mm3.at(strength);
  cut.lateral_strength_MPa = bone.lateral_strength_MPa.at(strength);
  scene.layers = std::move(layers);
  scene.force_law.kind = ForceLawKind::kCutting;
  scene.force_law.twist = procedure.twists;
  return {};
}

std::string explain(const Procedure& p) {
  std::string text = std::string(p.name) + ": " + std::string(p.title) + "\n";
  text +=
      text_line("  %-34s %10s %10s %10s %-8s %s\n", "", "median", "low", "high", "unit", "source");
  text += text_line("  %-34s %s\n", "tool", std::string(p.kind).c_str());
  text += line("  diameter", "mm", p.diameter_mm);
  if (p.bore_mm.median > 0) text += line("  bore", "mm", p.bore_mm);
  if (p.half_angle_deg.median < 90) text += line("  half angle", "degrees", p.half_angle_deg);
  text += text_line("  %-34s %s\n", "bone",
                    "strength from HU by kopperdahl-power (Kopperdahl et al. 2002)");
  text += line("  pressure over strength", "", p.bone.pressure_over_yield);
  text += line("  tearing", "N/m", p.bone.tearing_N_per_m);
  text += line("  friction coefficient", "", p.bone.friction_coefficient);
  text += line("  lateral stiffness", "N/mm^3", p.bone.foundation_N_per_mm3);
  text += line("  lateral strength", "MPa", p.bone.lateral_strength_MPa);
  for (const ProcedureLayer& layer : p.layers) {
    text += "  " + std::string(layer.name) + "\n";
    text += line("  thickness", "mm", layer.thickness_mm);
    text += line("  toughness", "J/m^2", layer.toughness_J_per_m2);
    text += line("  stiffness", "N/m", layer.stiffness_N_per_m);
    text += line("  stiffening", "N/m^2", layer.stiffening_N_per_m2);
    text += line("  friction", "N/m", layer.friction_N_per_m);
    if (layer.gap_mm > 0) text += line("  gap below", "mm", one(layer.gap_mm, kAssumed));
  }
  return text;
}

}  // namespace trocar
