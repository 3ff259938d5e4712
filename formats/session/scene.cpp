// SPDX-License-Identifier: Apache-2.0
#include "formats/session/scene.h"

#include <algorithm>
#include <cmath>
#include <span>

#include "formats/base/file_io.h"
#include "formats/base/strict_json.h"
#include "formats/geometry/slice_mesh.h"

namespace trocar {
namespace {

constexpr std::uint64_t kMaxSceneBytes = std::uint64_t{4} << 20;
constexpr double kMaxPosition_m = 1.0;    // of anything in the device's frame
constexpr double kMaxAnchor_mm = 4096.0;  // keeps lattice coordinates far below kMaxCoordinate
constexpr double kMaxAngle_deg = 360.0;
constexpr double kMaxToolSize_m = 0.05;
constexpr double kRounding_m = 1e-12;  // of two heights and their difference; theirs is 4e-16

void read_placement(const nlohmann::json& value, JsonErrors& errors, Placement& placement) {
  StrictObject object(value, "/placement", errors);
  if (object.has("anchor") && object.has("anchor_mm")) {
    errors.add("/placement", "has both anchor and anchor_mm");
  }
  if (object.has("anchor")) {
    if (object.string("anchor") != "centroid") {
      errors.add(object.path("anchor"), "must be \"centroid\" (a point is given by anchor_mm)");
    }
  } else {
    std::array<double, 2> anchor_mm{};
    object.numbers("anchor_mm", anchor_mm, -kMaxAnchor_mm, kMaxAnchor_mm, true);
    placement.anchor_mm = anchor_mm;
  }
  object.numbers("at_m", placement.at_m, -kMaxPosition_m, kMaxPosition_m, false);
  placement.rotation_deg = object.number("rotation_deg", -kMaxAngle_deg, kMaxAngle_deg, 0.0);
  object.finish();
}

void read_slices(const nlohmann::json& array, JsonErrors& errors, std::vector<SceneSlice>& slices) {
  for (std::size_t i = 0; i < array.size(); ++i) {
    StrictObject object(array[i], "/slices/" + std::to_string(i), errors);
    SceneSlice slice;
    slice.index = static_cast<int>(object.integer("index", 0, 1'000'000));
    slice.z_m = object.number("z_m", -kMaxPosition_m, kMaxPosition_m);
    if (object.has("tissue")) slice.tissue = object.string("tissue");
    object.finish();
    for (std::size_t j = 0; j < slices.size(); ++j) {
      if (std::abs(slices[j].z_m - slice.z_m) < kMinSliceGap_m - kRounding_m) {
        errors.add(object.path("z_m"),
                   "is less than 0.1 mm from /slices/" + std::to_string(j) + " in height");
      }
    }
    slices.push_back(slice);
  }
}

ShaftTissue read_shaft(const nlohmann::json& value, const std::string& path, JsonErrors& errors) {
  StrictObject object(value, path, errors);
  ShaftTissue shaft;
  shaft.dry_friction_N = object.number("dry_friction_N", 0.0, 100.0, 0.0);
  shaft.viscous_friction_N_s_per_m = object.number("viscous_friction_N_s_per_m", 0.0, 1000.0, 0.0);
  shaft.presliding_m = object.number("presliding_m", 1e-5, 0.01, shaft.presliding_m);
  shaft.rim_stiffness_N_per_m = object.number("rim_stiffness_N_per_m", 0.0, 1e5, 0.0);
  object.finish();
  return shaft;
}

BoneByHu read_bone(const nlohmann::json& value, const std::string& path, JsonErrors& errors) {
  StrictObject object(value, path, errors);
  BoneByHu bone;
  bone.law = object.string("law");
  bone.calibration_is_given = object.has("g_per_cm3_per_HU") || object.has("g_per_cm3_at_0_HU");
  bone.per_HU = object.number("g_per_cm3_per_HU", 0.0, 0.01, bone.per_HU);
  bone.at_0_HU = object.number("g_per_cm3_at_0_HU", -1.0, 1.0, bone.at_0_HU);
  if (object.has("density")) {
    bone.density = object.string("density");
    if (bone.density != "qct" && bone.density != "ash" && bone.density != "apparent")
      errors.add(object.path("density"), "must be \"qct\", \"ash\" or \"apparent\"");
  }
  object.finish();
  return bone;
}

CutTissue read_cut(const nlohmann::json& value, const std::string& path, JsonErrors& errors) {
  StrictObject object(value, path, errors);
  CutTissue cut;
  if (object.has("strength_MPa") == object.has("bone"))
    errors.add(path, "must have either strength_MPa or bone");
  if (object.has("strength_MPa")) cut.strength_MPa = object.number("strength_MPa", 0.0, 1000.0);
  if (const auto* bone = object.optional_value("bone"))
    cut.bone = read_bone(*bone, object.path("bone"), errors);
  cut.tearing_N_per_m = object.number("tearing_N_per_m", 0.0, 1e6, 0.0);
  cut.pressure_over_yield = object.number("pressure_over_yield", 0.01, 100.0, 1.0);
  cut.modulus_MPa = object.number("modulus_MPa", 0.0, 1e5, 0.0);
  cut.friction_coefficient = object.number("friction_coefficient", 0.0, 2.0, 0.0);
  cut.friction_kPa = object.number("friction_kPa", 0.0, 1e5, 0.0);
  cut.bed_N_per_mm3 = object.number("bed_N_per_mm3", 0.0, 1e4, 0.0);
  cut.lateral_strength_MPa = object.number("lateral_strength_MPa", 0.0, 1000.0, 0.0);
  if (cut.bed_N_per_mm3 > 0 && !(cut.lateral_strength_MPa > 0))
    errors.add(object.path("lateral_strength_MPa"), "must be above 0 beside bed_N_per_mm3");
  object.finish();
  return cut;
}

// Reads the fields of a tissue. The caller reads further keys and calls finish().
Tissue read_tissue_fields(StrictObject& object, JsonErrors& errors) {
  Tissue tissue;
  tissue.stiffness_N_per_m = object.number("stiffness_N_per_m", 1.0, 1e5, tissue.stiffness_N_per_m);
  tissue.threshold_N = object.number("threshold_N", 0.01, 1000.0, tissue.threshold_N);
  tissue.damping_N_s_per_m =
      object.number("damping_N_s_per_m", 0.0, 1000.0, tissue.damping_N_s_per_m);
  if (const auto* value = object.optional_value("shaft")) {
    tissue.shaft = read_shaft(*value, object.path("shaft"), errors);
  }
  if (const auto* value = object.optional_value("cut"))
    tissue.cut = read_cut(*value, object.path("cut"), errors);
  return tissue;
}

Tissue read_tissue(const nlohmann::json& value, JsonErrors& errors) {
  StrictObject object(value, "/tissue", errors);
  Tissue tissue = read_tissue_fields(object, errors);
  object.finish();
  return tissue;
}

void read_tissues(const nlohmann::json& array, JsonErrors& errors,
                  std::vector<NamedTissue>& tissues) {
  for (std::size_t i = 0; i < array.size(); ++i) {
    StrictObject object(array[i], "/tissues/" + std::to_string(i), errors);
    NamedTissue tissue;
    tissue.name = object.string("name");
    if (object.has("labels") && object.has("hu")) {
      errors.add("/tissues/" + std::to_string(i), "has both labels and hu");
    }
    if (object.has("labels")) {
      const nlohmann::json* labels = object.array("labels", 1, 256);
      for (std::size_t k = 0; labels != nullptr && k < labels->size(); ++k) {
        const nlohmann::json& label = (*labels)[k];
        if (!label.is_number_integer() || label < 0 || label > 65535) {
          errors.add(object.path("labels"), "must be integers from 0 to 65535");
          break;
        }
        tissue.labels.push_back(label.get<int>());
      }
    }
    if (object.has("hu")) {
      std::array<double, 2> hu{};
      object.numbers("hu", hu, -32768, 32767, true);
      if (!(hu[0] <= hu[1])) errors.add(object.path("hu"), "must be [lowest, highest]");
      tissue.hu = hu;
    }
    tissue.tissue = read_tissue_fields(object, errors);
    object.finish();
    for (const NamedTissue& other : tissues) {
      if (other.name == tissue.name) errors.add(object.path("name"), "occurs twice");
    }
    tissues.push_back(std::move(tissue));
  }
}

SceneBody read_body(const nlohmann::json& value, JsonErrors& errors) {
  StrictObject object(value, "/body", errors);
  SceneBody body;
  body.from = static_cast<int>(object.integer("from", 0, 1'000'000));
  body.to = static_cast<int>(object.integer("to", 0, 1'000'000));
  if (body.to < body.from || body.to - body.from >= static_cast<int>(kMaxSceneSlices))
    errors.add(object.path("to"), "must be from \"from\" on, and at most 64 slices");
  body.top_z_m = object.number("top_z_m", -kMaxPosition_m, kMaxPosition_m);
  if (const auto* shell = object.optional_value("shell")) {
    StrictObject part(*shell, "/body/shell", errors);
    body.shell_m = part.number("thickness_m", 1e-4, 0.01);
    body.shell_factor = part.number("strength_factor", 0.1, 100.0, body.shell_factor);
    part.finish();
  }
  object.finish();
  return body;
}

void read_layers(const nlohmann::json& array, JsonErrors& errors, std::vector<SceneLayer>& layers) {
  for (std::size_t i = 0; i < array.size(); ++i) {
    StrictObject object(array[i], "/layers/" + std::to_string(i), errors);
    SceneLayer layer;
    layer.name = object.string("name");
    layer.top_z_m = object.number("top_z_m", -kMaxPosition_m, kMaxPosition_m);
    layer.thickness_m = object.number("thickness_m", 1e-5, 0.2);
    layer.stiffness_N_per_m = object.number("stiffness_N_per_m", 0.0, 1e5, 0.0);
    layer.stiffening_N_per_m2 = object.number("stiffening_N_per_m2", 0.0, 1e9, 0.0);
    layer.puncture_N = object.number("puncture_N", 0.0, 1000.0);
    layer.cutting_N = object.number("cutting_N", 0.0, 1000.0, 0.0);
    layer.friction_N_per_m = object.number("friction_N_per_m", 0.0, 1e5, 0.0);
    object.finish();
    if (!(layer.stiffness_N_per_m + layer.stiffening_N_per_m2 > 0))
      errors.add(object.path("stiffness_N_per_m"), "must be above 0, or stiffening_N_per_m2");
    if (layer.cutting_N > layer.puncture_N)
      errors.add(object.path("cutting_N"), "must not be above puncture_N");
    if (!layers.empty() && layer.top_z_m > layers.back().top_z_m - layers.back().thickness_m)
      errors.add(object.path("top_z_m"), "must be below the layer before it");
    layers.push_back(layer);
  }
}

void check_tissue_names(const Scene& scene, JsonErrors& errors) {
  for (std::size_t i = 0; i < scene.slices.size(); ++i) {
    const std::optional<std::string>& wanted = scene.slices[i].tissue;
    if (wanted && std::none_of(scene.tissues.begin(), scene.tissues.end(),
                               [&](const NamedTissue& t) { return t.name == *wanted; })) {
      errors.add("/slices/" + std::to_string(i) + "/tissue", "is not in /tissues");
    }
  }
}

// In nanometres, as integers, so that the exact predicates can be used.
LatticePoint in_nm(const std::array<double, 2>& p_m) {
  return {static_cast<std::int32_t>(std::lrint(p_m[0] * 1e9)),
          static_cast<std::int32_t>(std::lrint(p_m[1] * 1e9))};
}

bool is_simple(const Ring& ring) {
  const std::size_t n = ring.size();
  for (std::size_t i = 0; i < n; ++i) {
    if (ring[i] == ring[(i + 1) % n]) return false;
    for (std::size_t j = i + 1; j < n; ++j) {
      if (segments_cross(ring[i], ring[(i + 1) % n], ring[j], ring[(j + 1) % n])) return false;
      if (j > i + 1 && ring[i] == ring[j]) return false;
    }
  }
  return true;
}

void read_outline(const nlohmann::json& array, const std::string& path, JsonErrors& errors,
                  SceneTool& tool) {
  Ring ring;
  for (const nlohmann::json& corner : array) {
    std::array<double, 2> p_m{};
    const bool is_pair =
        corner.is_array() && corner.size() == 2 && corner[0].is_number() && corner[1].is_number();
    for (std::size_t k = 0; k < 2; ++k) {
      if (is_pair) p_m[k] = corner[k].get<double>();
      if (!is_pair || !(std::abs(p_m[k]) <= kMaxToolSize_m)) {
        return errors.add(path, "must be pairs of numbers within -0.05 and 0.05");
      }
    }
    tool.outline_m.push_back(p_m);
    ring.push_back(in_nm(p_m));
  }
  if (!is_simple(ring) || doubled_area(ring) == 0) {
    return errors.add(path, "must be a simple polygon");
  }
  if (doubled_area(ring) < 0) std::reverse(tool.outline_m.begin(), tool.outline_m.end());
}

SceneTool read_tool(const nlohmann::json& value, JsonErrors& errors) {
  StrictObject object(value, "/tool", errors);
  SceneTool tool;
  if (object.has("outline_m")) {
    if (object.has("sides") || object.has("radius_m")) {
      errors.add("/tool", "has both outline_m and sides or radius_m");
    }
    if (const nlohmann::json* array = object.array("outline_m", 3, kMaxToolSides)) {
      read_outline(*array, object.path("outline_m"), errors, tool);
    }
    tool.sides = static_cast<int>(tool.outline_m.size());
  }
  if (object.has("kind")) tool.kind = object.string("kind");
  tool.half_angle_deg = object.number("half_angle_deg", 1.0, 90.0, tool.half_angle_deg);
  tool.inner_radius_m = object.number("inner_radius_m", 0.0, kMaxToolSize_m, 0.0);
  tool.sides = static_cast<int>(object.integer("sides", 3, kMaxToolSides, tool.sides));
  tool.radius_m = object.number("radius_m", 1e-4, kMaxToolSize_m, tool.radius_m);
  tool.rotation_deg = object.number("rotation_deg", -kMaxAngle_deg, kMaxAngle_deg, 0.0);
  tool.tilt_deg = object.number("tilt_deg", 0.0, kMaxTilt_deg, 0.0);
  tool.tilt_azimuth_deg = object.number("tilt_azimuth_deg", -kMaxAngle_deg, kMaxAngle_deg, 0.0);
  object.numbers("tip_in_plate_m", tool.tip_in_plate_m, -0.5, 0.5, false);
  object.finish();
  return tool;
}

SceneHand read_hand(const nlohmann::json& value, JsonErrors& errors) {
  StrictObject object(value, "/hand", errors);
  SceneHand hand;
  const auto optional = [&](const char* key, double lowest,
                            double highest) -> std::optional<double> {
    if (!object.has(key)) return std::nullopt;
    return object.number(key, lowest, highest);
  };
  hand.stiffness_N_per_m = optional("stiffness_N_per_m", 0.0, 1e5);
  hand.damping_N_s_per_m = optional("damping_N_s_per_m", 0.0, 1e4);
  hand.rotation_stiffness_Nm_per_rad = optional("rotation_stiffness_Nm_per_rad", 0.0, 1e4);
  hand.rotation_damping_Nm_s_per_rad = optional("rotation_damping_Nm_s_per_rad", 0.0, 1e3);
  hand.mass_kg = optional("mass_kg", 0.0, 10.0);
  hand.let_go_t_s = optional("let_go_t_s", 0.0, kMaxDuration_s);
  if (object.has("grip")) {
    const std::string grip = object.string("grip");
    if (grip != "firm" && grip != "light" && grip != "stiff") {
      errors.add(object.path("grip"), "must be \"firm\", \"light\" or \"stiff\"");
    }
    hand.grip = grip == "light"   ? HandGrip::kLight
                : grip == "stiff" ? HandGrip::kStiff
                                  : HandGrip::kFirm;
  }
  if (const nlohmann::json* frames = object.array("trajectory", 1, kMaxKeyframes)) {
    for (std::size_t i = 0; i < frames->size(); ++i) {
      StrictObject frame((*frames)[i], object.path("trajectory") + "/" + std::to_string(i), errors);
      TipKeyframe keyframe;
      keyframe.t_s = frame.number("t_s", 0.0, kMaxDuration_s);
      frame.numbers("tip_m", keyframe.tip_m, -kMaxPosition_m, kMaxPosition_m, true);
      frame.numbers("rotation_deg", keyframe.rotation_deg, -kMaxAngle_deg, kMaxAngle_deg, false);
      frame.finish();
      if (i == 0 && keyframe.t_s != 0.0) errors.add(frame.path("t_s"), "must be 0 in the first");
      if (i > 0 && !(keyframe.t_s > hand.trajectory.back().t_s)) {
        errors.add(frame.path("t_s"), "must be later than the keyframe before it");
      }
      hand.trajectory.push_back(keyframe);
    }
  }
  object.finish();
  return hand;
}

// One of `names`, the first if the key is missing.
template <std::size_t N>
std::size_t read_choice(StrictObject& object, const char* key,
                        const std::array<const char*, N>& names, JsonErrors& errors) {
  if (!object.has(key)) return 0;
  const std::string name = object.string(key);
  const auto found = std::find(names.begin(), names.end(), name);
  if (found != names.end()) return static_cast<std::size_t>(found - names.begin());
  std::string list;
  for (std::size_t i = 0; i < N; ++i)
    list.append(i == 0 ? "" : i + 1 < N ? ", " : " or ").append(names[i]);
  errors.add(object.path(key), "must be " + list);
  return 0;
}

void read_cutting(StrictObject& object, JsonErrors& errors, ForceLaw& law) {
  law.axis = static_cast<ToolAxis>(
      read_choice(object, "axis", std::array{"auto", "rigid", "coupled"}, errors));
  law.coupling_N_per_m = object.number("coupling_N_per_m", 100.0, 1e6, law.coupling_N_per_m);
  law.coupling_Nm_per_rad = object.number("coupling_Nm_per_rad", 0.1, 1e4, law.coupling_Nm_per_rad);
  law.prediction = static_cast<PosePrediction>(
      read_choice(object, "prediction", std::array{"auto", "on", "off"}, errors));
  law.tip_friction = object.number("tip_friction", 0.0, 2.0, 0.0);
  law.twist = object.boolean("twist");
  law.force_scale = object.number("force_scale", 1e-3, 10.0, law.force_scale);
}

ForceLaw read_force_law(const nlohmann::json& value, JsonErrors& errors) {
  StrictObject object(value, "/force_law", errors);
  ForceLaw law;
  if (const auto kind = force_law_from_string(object.string("kind"))) {
    law.kind = *kind;
  } else {
    errors.add(object.path("kind"), "must be " + force_law_names("\""));
  }
  if (law.kind == ForceLawKind::kNetwork) {
    const std::string solver = object.has("solver") ? object.string("solver") : "auto";
    constexpr std::array<const char*, 4> kSolvers{"auto", "local", "global", "propagation"};
    const auto* const found = std::find(kSolvers.begin(), kSolvers.end(), solver);
    if (found == kSolvers.end()) {
      errors.add(object.path("solver"), "must be auto, local, global or propagation");
    } else {
      law.solver = static_cast<NetworkSolver>(found - kSolvers.begin());
    }
    law.reach_m = object.number("reach_m", 5e-4, 0.2, law.reach_m);
    if (law.solver == NetworkSolver::kAuto) {
      law.error_bound = object.number("error_bound", 1e-4, 0.5, law.error_bound);
    } else if (law.solver == NetworkSolver::kLocal) {
      law.radius_m = object.number("radius_m", 1e-3, 0.5, law.radius_m);
    } else if (law.solver == NetworkSolver::kPropagation) {
      law.depth = static_cast<int>(object.integer("depth", 1, 64, law.depth));
    }
  }
  if (law.kind == ForceLawKind::kCutting) read_cutting(object, errors, law);
  object.finish();
  return law;
}

using Point = std::array<double, 3>;

// Keeps `direction` as a unit vector; an error if it has no length.
void set_direction(const Point& way, const std::string& path, JsonErrors& errors,
                   PlannedLine& line) {
  constexpr double kLeastLength = 1e-6;
  const double length = std::hypot(way[0], way[1], way[2]);
  if (!(length >= kLeastLength)) return errors.add(path, "has no direction");
  for (std::size_t k = 0; k < 3; ++k)
    line.direction[k] = way[k] / length;
}

PlannedLine read_line(const nlohmann::json& value, const SceneGoals& goals, JsonErrors& errors) {
  StrictObject object(value, "/goals/line", errors);
  PlannedLine line;
  object.numbers("entry_m", line.entry_m, -kMaxPosition_m, kMaxPosition_m, true);
  if (object.has("direction") && object.has("to_m"))
    errors.add("/goals/line", "has both direction and to_m");
  Point way{};
  if (object.has("direction")) {
    object.numbers("direction", way, -kMaxPosition_m, kMaxPosition_m, true);
    set_direction(way, object.path("direction"), errors, line);
  } else if (object.has("to_m") || goals.target) {
    if (goals.target) way = goals.target->at_m;
    object.numbers("to_m", way, -kMaxPosition_m, kMaxPosition_m, false);
    for (std::size_t k = 0; k < 3; ++k)
      way[k] -= line.entry_m[k];
    set_direction(way, "/goals/line", errors, line);
  } else {
    errors.add("/goals/line", "must have direction or to_m, or stand beside a target");
  }
  if (object.has("entry_radius_m")) line.entry_radius_m = object.number("entry_radius_m", 1e-5, 1);
  if (object.has("corridor_m")) line.corridor_m = object.number("corridor_m", 1e-5, 1.0);
  object.finish();
  return line;
}

void read_capsule(const nlohmann::json& value, const std::string& path, JsonErrors& errors,
                  ForbiddenZone& zone) {
  StrictObject object(value, path, errors);
  zone.shape = ForbiddenZone::Shape::kCapsule;
  object.numbers("from_m", zone.low_m, -kMaxPosition_m, kMaxPosition_m, true);
  object.numbers("to_m", zone.high_m, -kMaxPosition_m, kMaxPosition_m, true);
  zone.radius_m = object.number("radius_m", 1e-5, kMaxPosition_m);
  object.finish();
}

void read_box(const nlohmann::json& value, const std::string& path, JsonErrors& errors,
              ForbiddenZone& zone) {
  StrictObject object(value, path, errors);
  zone.shape = ForbiddenZone::Shape::kBox;
  object.numbers("min_m", zone.low_m, -kMaxPosition_m, kMaxPosition_m, true);
  object.numbers("max_m", zone.high_m, -kMaxPosition_m, kMaxPosition_m, true);
  for (std::size_t k = 0; k < 3; ++k) {
    if (!(zone.low_m[k] < zone.high_m[k])) errors.add(object.path("max_m"), "must be above min_m");
  }
  object.finish();
}

void read_prism(const nlohmann::json& value, const std::string& path, JsonErrors& errors,
                ForbiddenZone& zone) {
  StrictObject object(value, path, errors);
  zone.shape = ForbiddenZone::Shape::kPrism;
  object.numbers("z_m", zone.z_m, -kMaxPosition_m, kMaxPosition_m, true);
  if (!(zone.z_m[0] < zone.z_m[1])) errors.add(object.path("z_m"), "must be [lowest, highest]");
  Ring ring;
  if (const nlohmann::json* array = object.array("outline_m", 3, kMaxZoneCorners)) {
    for (const nlohmann::json& corner : *array) {
      std::array<double, 2> p_m{};
      const bool is_pair =
          corner.is_array() && corner.size() == 2 && corner[0].is_number() && corner[1].is_number();
      for (std::size_t k = 0; k < 2; ++k) {
        if (is_pair) p_m[k] = corner[k].get<double>();
        if (!is_pair || !(std::abs(p_m[k]) <= kMaxPosition_m))
          return errors.add(object.path("outline_m"), "must be pairs of numbers within -1 and 1");
      }
      zone.outline_m.push_back(p_m);
      ring.push_back(in_nm(p_m));
    }
    if (!is_simple(ring) || doubled_area(ring) == 0)
      errors.add(object.path("outline_m"), "must be a simple polygon");
  }
  object.finish();
}

void read_zones(const nlohmann::json& array, JsonErrors& errors,
                std::vector<ForbiddenZone>& zones) {
  for (std::size_t i = 0; i < array.size(); ++i) {
    const std::string path = "/goals/zones/" + std::to_string(i);
    StrictObject object(array[i], path, errors);
    ForbiddenZone zone;
    zone.name = object.string("name");
    zone.margin_m = object.number("margin_m", 0.0, 0.1, 0.0);
    int shapes = 0;
    const auto read = [&](const char* key, auto&& reader) {
      const auto* value = object.optional_value(key);
      if (value == nullptr) return;
      ++shapes;
      reader(*value, object.path(key), errors, zone);
    };
    read("capsule", read_capsule);
    read("box", read_box);
    read("prism", read_prism);
    if (shapes != 1) errors.add(path, "must have one of capsule, box and prism");
    object.finish();
    for (const ForbiddenZone& other : zones) {
      if (other.name == zone.name) errors.add(object.path("name"), "occurs twice");
    }
    zones.push_back(std::move(zone));
  }
}

SceneGoals read_goals(const nlohmann::json& value, JsonErrors& errors) {
  StrictObject object(value, "/goals", errors);
  SceneGoals goals;
  if (const auto* target = object.optional_value("target")) {
    StrictObject part(*target, "/goals/target", errors);
    goals.target.emplace();
    part.numbers("at_m", goals.target->at_m, -kMaxPosition_m, kMaxPosition_m, true);
    goals.target->radius_m = part.number("radius_m", 1e-5, kMaxPosition_m);
    part.finish();
  }
  if (const auto* line = object.optional_value("line"))
    goals.line = read_line(*line, goals, errors);
  if (object.has("force_max_N")) goals.force_max_N = object.number("force_max_N", 0.01, 1000.0);
  if (object.has("time_max_s"))
    goals.time_max_s = object.number("time_max_s", 1e-3, kMaxDuration_s);
  if (object.has("plunge_max_m")) goals.plunge_max_m = object.number("plunge_max_m", 1e-5, 1.0);
  if (object.has("zones")) {
    if (const auto* zones = object.array("zones", 1, kMaxZones))
      read_zones(*zones, errors, goals.zones);
  }
  object.finish();
  return goals;
}

}  // namespace

std::optional<ForceLawKind> force_law_from_string(std::string_view name) noexcept {
  for (std::size_t i = 0; i < kForceLaws.size(); ++i) {
    if (name == kForceLaws[i].name) return static_cast<ForceLawKind>(i);
  }
  return std::nullopt;
}

std::string force_law_names(const std::string& quote) {
  std::string names;
  for (std::size_t i = 0; i < kForceLaws.size(); ++i) {
    const char* before = i == 0 ? "" : i + 1 < kForceLaws.size() ? ", " : " or ";
    names.append(before).append(quote).append(kForceLaws[i].name).append(quote);
  }
  return names;
}

Result<Scene> parse_scene(std::string_view text, const std::string& name,
                          const std::filesystem::path& folder) {
  const Result<nlohmann::json> document = parse_strict_json(text, name);
  if (!document) return document.error();
  JsonErrors errors{name, std::nullopt};
  StrictObject object(*document, "", errors);
  Scene scene;
  if (object.string("schema") != kSceneSchema) {
    errors.add(object.path("schema"), std::string("must be \"") + kSceneSchema + "\"");
  }
  scene.name = object.string("name");
  scene.asset = folder / object.string("asset");
  if (object.has("device")) scene.device = folder / object.string("device");
  scene.duration_s = object.number("duration_s", 1e-3, kMaxDuration_s);
  if (object.has("rate_Hz")) scene.rate_Hz = object.number("rate_Hz", kMinRate_Hz, kMaxRate_Hz);
  if (const auto* value = object.optional_value("placement")) {
    read_placement(*value, errors, scene.placement);
  }
  if (const auto* value = object.optional_value("body")) {
    if (object.has("slices")) errors.add("/body", "stands beside slices: give one of the two");
    scene.body = read_body(*value, errors);
  } else if (const auto* slices = object.array("slices", 1, kMaxSceneSlices)) {
    read_slices(*slices, errors, scene.slices);
  }
  if (object.has("layers")) {
    if (const auto* value = object.array("layers", 1, kMaxLayers))
      read_layers(*value, errors, scene.layers);
  }
  if (const auto* value = object.optional_value("tissue")) {
    scene.tissue = read_tissue(*value, errors);
    scene.tissue_is_given = true;
  }
  if (object.has("tissues")) {
    if (const auto* value = object.array("tissues", 1, kMaxTissues)) {
      read_tissues(*value, errors, scene.tissues);
    }
  }
  check_tissue_names(scene, errors);
  if (const auto* value = object.optional_value("force_law")) {
    scene.force_law = read_force_law(*value, errors);
  }
  if (const auto* value = object.optional_value("tool")) scene.tool = read_tool(*value, errors);
  if (const auto* value = object.optional_value("hand")) {
    scene.hand = read_hand(*value, errors);
  } else {
    errors.add(object.path("hand"), "is missing");
  }
  if (const auto* value = object.optional_value("goals")) scene.goals = read_goals(*value, errors);
  object.finish();
  if (errors.first) return *errors.first;
  return scene;
}

Result<Scene> read_scene(const std::filesystem::path& file) {
  const Result<std::vector<std::uint8_t>> bytes = read_file(file, kMaxSceneBytes);
  if (!bytes) return bytes.error();
  return parse_scene(std::string_view(reinterpret_cast<const char*>(bytes->data()), bytes->size()),
                     file.string(), file.has_parent_path() ? file.parent_path() : ".");
}

}  // namespace trocar
