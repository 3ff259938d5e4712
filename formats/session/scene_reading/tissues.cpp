// SPDX-License-Identifier: Apache-2.0
#include <limits>

#include "formats/session/scene_reading/scene_readers.h"

namespace trocar {
namespace {

void read_shaft(StrictObject& object, ShaftTissue& shaft) {
  object.read("dry_friction_N", shaft.dry_friction_N, 0.0, 100.0);
  object.read("viscous_friction_N_s_per_m", shaft.viscous_friction_N_s_per_m, 0.0, 1000.0);
  object.read("presliding_m", shaft.presliding_m, 1e-5, 0.01);
  object.read("rim_stiffness_N_per_m", shaft.rim_stiffness_N_per_m, 0.0, 1e5);
}

void read_bone(StrictObject& object, BoneByHu& bone) {
  bone.law = object.string("law");
  bone.calibration_is_given = object.has("g_per_cm3_per_HU") || object.has("g_per_cm3_at_0_HU");
  object.read("g_per_cm3_per_HU", bone.per_HU, 0.0, 0.01);
  object.read("g_per_cm3_at_0_HU", bone.at_0_HU, -1.0, 1.0);
  constexpr std::array kDensities{"qct", "ash", "apparent"};
  bone.density = kDensities.at(object.choice("density", kDensities));
}

void read_cut(StrictObject& object, CutTissue& cut) {
  if (object.has("strength_MPa") == object.has("bone"))
    object.error("must have either strength_MPa or bone");
  object.read("strength_MPa", cut.strength_MPa, 0.0, 1000.0);
  object.section("bone", [&](StrictObject& bone) { read_bone(bone, cut.bone.emplace()); });
  object.read("tearing_N_per_m", cut.tearing_N_per_m, 0.0, 1e6);
  object.read("pressure_over_yield", cut.pressure_over_yield, 0.01, 100.0);
  object.read("modulus_MPa", cut.modulus_MPa, 0.0, 1e5);
  object.read("friction_coefficient", cut.friction_coefficient, 0.0, 2.0);
  object.read("friction_kPa", cut.friction_kPa, 0.0, 1e5);
  object.read("bed_N_per_mm3", cut.foundation_N_per_mm3, 0.0, 1e4);
  object.read("lateral_strength_MPa", cut.lateral_strength_MPa, 0.0, 1000.0);
  if (cut.foundation_N_per_mm3 > 0 && !(cut.lateral_strength_MPa > 0))
    object.error("lateral_strength_MPa", "must be above 0 if bed_N_per_mm3 is");
}

void read_labels(StrictObject& object, std::vector<int>& labels) {
  const nlohmann::json* list = object.array("labels", 1, 256);
  for (std::size_t k = 0; list != nullptr && k < list->size(); ++k) {
    const nlohmann::json& label = (*list)[k];
    if (!label.is_number_integer() || label < 0 || label > std::numeric_limits<int>::max())
      return object.error("labels", "must be integers from 0 to 2147483647");
    labels.push_back(label.get<int>());
  }
}

}  // namespace

void read_tissue(StrictObject& object, Tissue& tissue) {
  tissue.stiffness_is_given = object.has("stiffness_N_per_m");
  object.read("stiffness_N_per_m", tissue.stiffness_N_per_m, 1.0, 1e7);
  object.read("threshold_N", tissue.threshold_N, 0.01, 1000.0);
  object.read("damping_N_s_per_m", tissue.damping_N_s_per_m, 0.0, 1000.0);
  object.section("shaft", [&](StrictObject& shaft) { read_shaft(shaft, tissue.shaft); });
  object.section("cut", [&](StrictObject& cut) { read_cut(cut, tissue.cut.emplace()); });
}

void read_tissues(StrictObject& scene, std::vector<NamedTissue>& tissues) {
  scene.elements("tissues", 1, kMaxTissues, [&](StrictObject& object) {
    NamedTissue& tissue = tissues.emplace_back();
    tissue.name = object.string("name");
    if (object.has("labels") && object.has("hu")) object.error("has both labels and hu");
    if (object.has("labels")) read_labels(object, tissue.labels);
    if (object.has("hu")) {
      std::array<double, 2>& hu = tissue.hu.emplace();
      object.numbers("hu", hu, -32768, 32767, true);
      if (!(hu[0] <= hu[1])) object.error("hu", "must be [lowest, highest]");
    }
    read_tissue(object, tissue.tissue);
    check_last_name(tissues, object);
  });
}

void read_layers(StrictObject& scene, std::vector<SceneLayer>& layers) {
  scene.elements("layers", 1, kMaxLayers, [&](StrictObject& object) {
    SceneLayer layer;
    layer.name = object.string("name");
    layer.top_z_m = object.number("top_z_m", -kMaxPosition_m, kMaxPosition_m);
    layer.thickness_m = object.number("thickness_m", 1e-5, 0.2);
    object.read("stiffness_N_per_m", layer.stiffness_N_per_m, 0.0, 1e5);
    object.read("stiffening_N_per_m2", layer.stiffening_N_per_m2, 0.0, 1e9);
    if (object.has("toughness_J_per_m2")) {
      if (object.has("puncture_N")) object.error("has both toughness_J_per_m2 and puncture_N");
      layer.toughness_J_per_m2 = object.number("toughness_J_per_m2", 1.0, 1e6);
    } else {
      layer.puncture_N = object.number("puncture_N", 0.0, 1000.0);
    }
    layer.cutting_is_given = object.has("cutting_N");
    object.read("cutting_N", layer.cutting_N, 0.0, 1000.0);
    object.read("friction_N_per_m", layer.friction_N_per_m, 0.0, 1e5);
    if (!(layer.stiffness_N_per_m + layer.stiffening_N_per_m2 > 0))
      object.error("stiffness_N_per_m", "must be above 0, or stiffening_N_per_m2");
    if (layer.cutting_N > layer.puncture_N && !(layer.toughness_J_per_m2 > 0))
      object.error("cutting_N", "must not be above puncture_N");
    if (!layers.empty() && layer.top_z_m > layers.back().top_z_m - layers.back().thickness_m)
      object.error("top_z_m", "must be below the layer before it");
    layers.push_back(layer);
  });
}

}  // namespace trocar
