// SPDX-License-Identifier: Apache-2.0
#include "formats/session/scene.h"

#include <algorithm>
#include <cmath>
#include <deque>
#include <limits>

#include "formats/base/files.h"
#include "formats/base/json.h"
#include "formats/mesh/slice_mesh.h"
#include "formats/session/procedures.h"

namespace trocar {
namespace {

/// A deque, so that references from traits_of() stay valid when a row is added.
std::deque<ForceLawTraits>& rows() {
  static std::deque<ForceLawTraits> table(kForceLaws.begin(), kForceLaws.end());
  return table;
}

constexpr std::uint64_t kMaxSceneBytes = std::uint64_t{4} << 20;
constexpr double kMaxAnchor_mm = 4096.0;  // keeps lattice coordinates far below kMaxCoordinate
constexpr double kMaxAngle_deg = 360.0;
constexpr double kMaxToolSize_m = 0.05;
constexpr int kMaxSliceIndex = 1'000'000;
// Tolerance for the rounding errors of two heights and of their difference, together 4e-16 m.
constexpr double kRounding_m = 1e-12;
constexpr double kMaxPosition_m = 1.0;  // largest |coordinate| in the device's frame

/// Adds an error if the last element has the same name as an earlier one.
template <typename Named>
void check_last_name(const std::vector<Named>& list, StrictObject& object) {
  for (std::size_t i = 0; i + 1 < list.size(); ++i) {
    if (list[i].name == list.back().name) object.error("name", "occurs twice");
  }
}

// The corners as lattice points with a step of one nanometre, so that the exact predicates can be
// used.
Ring in_nm(std::span<const std::array<double, 2>> polygon_m) {
  Ring ring;
  for (const auto& [x_m, y_m] : polygon_m)
    ring.push_back({static_cast<std::int32_t>(std::lrint(x_m * 1e9)),
                    static_cast<std::int32_t>(std::lrint(y_m * 1e9))});
  return ring;
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

/// Reads the corners of a polygon. Adds an error if the polygon is not simple, has too many corners,
/// or has a |coordinate| above `max_m`.
std::vector<std::array<double, 2>> read_polygon(StrictObject& object, const char* key,
                                                std::size_t max_corners, double max_m) {
  std::vector<std::array<double, 2>> polygon_m;
  const nlohmann::json* list = object.array(key, 3, max_corners);
  for (std::size_t i = 0; list != nullptr && i < list->size(); ++i) {
    const nlohmann::json& corner = (*list)[i];
    const bool is_pair =
        corner.is_array() && corner.size() == 2 && corner[0].is_number() && corner[1].is_number();
    if (is_pair) polygon_m.push_back({corner[0].get<double>(), corner[1].get<double>()});
    if (!is_pair || !(std::abs(polygon_m[i][0]) <= max_m && std::abs(polygon_m[i][1]) <= max_m)) {
      const std::string max = json_text(max_m);
      std::string reason = "must be pairs of numbers within -";
      reason.append(max).append(" and ").append(max);
      object.error(key, reason);
      return {};
    }
  }
  const Ring ring = in_nm(polygon_m);
  if (list != nullptr && (!is_simple(ring) || doubled_area(ring) == 0))
    object.error(key, "must be a simple polygon");
  return polygon_m;
}

bool is_clockwise(std::span<const std::array<double, 2>> polygon_m) {
  return doubled_area(in_nm(polygon_m)) < 0;
}

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
    SceneLayer layer{.name = object.string("name"),
                     .top_z_m = object.number("top_z_m", -kMaxPosition_m, kMaxPosition_m),
                     .thickness_m = object.number("thickness_m", 1e-5, 0.2)};
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

void read_network(StrictObject& object, SceneForceLaw& law) {
  law.solver = static_cast<NetworkSolver>(
      object.choice("solver", std::array{"auto", "local", "global", "propagation"}));
  object.read("reach_m", law.decay_length_m, 5e-4, 0.2);
  if (law.solver == NetworkSolver::kAuto) object.read("error_bound", law.error_bound, 1e-4, 0.5);
  if (law.solver == NetworkSolver::kLocal) object.read("radius_m", law.radius_m, 1e-3, 0.5);
  if (law.solver == NetworkSolver::kPropagation)
    law.depth = static_cast<int>(object.integer("depth", 1, 64, law.depth));
}

void read_cutting(StrictObject& object, SceneForceLaw& law) {
  law.axis = static_cast<ToolAxis>(object.choice("axis", std::array{"auto", "rigid", "coupled"}));
  object.read("coupling_N_per_m", law.coupling_N_per_m, 100.0, 1e6);
  object.read("coupling_Nm_per_rad", law.coupling_Nm_per_rad, 0.1, 1e4);
  object.choice("prediction", std::array{"auto", "on", "off"});  // of versions before 0.4.0
  object.read("tip_friction", law.tip_friction, 0.0, 2.0);
  object.read("tip_hold", law.tip_hold, 0.0, 1.0);
  law.twist = object.boolean("twist");
}

void read_force_law(StrictObject& object, SceneForceLaw& law) {
  if (const auto kind = force_law_from_string(object.string("kind")))
    law.kind = *kind;
  else
    object.error("kind", "must be " + force_law_names("\""));
  object.read("force_scale", law.force_scale, 1e-3, 10.0);
  if (law.kind == ForceLawKind::kNetwork) read_network(object, law);
  if (law.kind == ForceLawKind::kCutting) read_cutting(object, law);
}

using Point = std::array<double, 3>;

void read_point(StrictObject& object, const char* key, Point& point_m) {
  object.numbers(key, point_m, -kMaxPosition_m, kMaxPosition_m, true);
}

// Sets the line's direction to the unit vector of `way`; false if that has no length.
bool set_direction(const Point& way, PlannedLine& line) {
  constexpr double kMinLength = 1e-6;
  const double length = std::hypot(way[0], way[1], way[2]);
  for (std::size_t k = 0; k < 3; ++k)
    line.direction[k] = way[k] / length;
  return length >= kMinLength;
}

// The direction is given, or leads from the entry to `to_m` or to the target.
void read_line(StrictObject& object, const SceneGoals& goals, PlannedLine& line) {
  read_point(object, "entry_m", line.entry_m);
  if (object.has("direction") && object.has("to_m")) object.error("has both direction and to_m");
  Point way{};
  if (object.has("direction")) {
    read_point(object, "direction", way);
    if (!set_direction(way, line)) object.error("direction", "has no direction");
  } else if (object.has("to_m") || goals.target) {
    if (goals.target) way = goals.target->at_m;
    object.numbers("to_m", way, -kMaxPosition_m, kMaxPosition_m, false);
    for (std::size_t k = 0; k < 3; ++k)
      way[k] -= line.entry_m[k];
    if (!set_direction(way, line)) object.error("has no direction");
  } else {
    object.error("must have direction or to_m, or the goals must have a target");
  }
  object.read("entry_radius_m", line.entry_radius_m, 1e-5, 1.0);
  object.read("corridor_m", line.corridor_m, 1e-5, 1.0);
}

void read_capsule(StrictObject& object, ForbiddenZone& zone) {
  zone.shape = ForbiddenZone::Shape::kCapsule;
  read_point(object, "from_m", zone.low_m);
  read_point(object, "to_m", zone.high_m);
  zone.radius_m = object.number("radius_m", 1e-5, kMaxPosition_m);
}

void read_box(StrictObject& object, ForbiddenZone& zone) {
  zone.shape = ForbiddenZone::Shape::kBox;
  read_point(object, "min_m", zone.low_m);
  read_point(object, "max_m", zone.high_m);
  for (std::size_t k = 0; k < 3; ++k) {
    if (!(zone.low_m[k] < zone.high_m[k])) object.error("max_m", "must be above min_m");
  }
}

void read_prism(StrictObject& object, ForbiddenZone& zone) {
  zone.shape = ForbiddenZone::Shape::kPrism;
  object.numbers("z_m", zone.z_m, -kMaxPosition_m, kMaxPosition_m, true);
  if (!(zone.z_m[0] < zone.z_m[1])) object.error("z_m", "must be [lowest, highest]");
  zone.outline_m = read_polygon(object, "outline_m", kMaxZoneCorners, kMaxPosition_m);
}

void read_zone(StrictObject& object, ForbiddenZone& zone) {
  zone.name = object.string("name");
  object.read("margin_m", zone.margin_m, 0.0, 0.1);
  int shapes = 0;
  const auto read = [&](const char* key, auto&& reader) {
    shapes += object.section(key, [&](StrictObject& shape) { reader(shape, zone); }) ? 1 : 0;
  };
  read("capsule", read_capsule);
  read("box", read_box);
  read("prism", read_prism);
  if (shapes != 1) object.error("must have one of capsule, box and prism");
}

void read_goals(StrictObject& object, SceneGoals& goals) {
  object.section("target", [&](StrictObject& target) {
    GoalTarget& out = goals.target.emplace();
    read_point(target, "at_m", out.at_m);
    out.radius_m = target.number("radius_m", 1e-5, kMaxPosition_m);
  });
  object.section("line", [&](StrictObject& line) { read_line(line, goals, goals.line.emplace()); });
  object.read("force_max_N", goals.force_max_N, 0.01, 1000.0);
  object.read("time_max_s", goals.time_max_s, 1e-3, kMaxDuration_s);
  object.read("plunge_max_m", goals.plunge_max_m, 1e-5, 1.0);
  if (!object.has("zones")) return;
  object.elements("zones", 1, kMaxZones, [&](StrictObject& zone) {
    read_zone(zone, goals.zones.emplace_back());
    check_last_name(goals.zones, zone);
  });
}

int read_index(StrictObject& object, const char* key) {
  return static_cast<int>(object.integer(key, 0, kMaxSliceIndex));
}

void read_placement(StrictObject& object, Placement& placement) {
  if (object.has("anchor") && object.has("anchor_mm"))
    object.error("has both anchor and anchor_mm");
  if (object.has("anchor")) {
    if (object.string("anchor") != "centroid")
      object.error("anchor", "must be \"centroid\" (a point is given by anchor_mm)");
  } else {
    object.numbers("anchor_mm", placement.anchor_mm.emplace(), -kMaxAnchor_mm, kMaxAnchor_mm, true);
  }
  object.numbers("at_m", placement.at_m, -kMaxPosition_m, kMaxPosition_m, false);
  object.read("rotation_deg", placement.rotation_deg, -kMaxAngle_deg, kMaxAngle_deg);
}

void read_slices(StrictObject& scene, std::vector<SceneSlice>& slices) {
  scene.elements("slices", 1, kMaxSceneSlices, [&](StrictObject& object) {
    SceneSlice slice;
    slice.index = read_index(object, "index");
    slice.z_m = object.number("z_m", -kMaxPosition_m, kMaxPosition_m);
    if (object.has("tissue")) slice.tissue = object.string("tissue");
    for (std::size_t j = 0; j < slices.size(); ++j) {
      if (std::abs(slices[j].z_m - slice.z_m) < kMinSliceGap_m - kRounding_m)
        object.error("z_m", "is less than 0.1 mm from /slices/" + std::to_string(j) + " in height");
    }
    slices.push_back(slice);
  });
}

void read_bone_volume(StrictObject& object, SceneBody& body) {
  body.from = read_index(object, "from");
  body.to = read_index(object, "to");
  if (body.to < body.from || body.to - body.from >= static_cast<int>(kMaxSceneSlices))
    object.error("to", "must be at least \"from\", with at most 64 slices");
  body.top_z_m = object.number("top_z_m", -kMaxPosition_m, kMaxPosition_m);
  object.section("shell", [&](StrictObject& shell) {
    body.shell_m = shell.number("thickness_m", 1e-4, 0.01);
    shell.read("strength_factor", body.shell_factor, 0.1, 100.0);
    shell.read("free_radius_m", body.shell_free_radius_m, 1e-4, 0.05);
  });
  object.read("cortex_HU", body.cortex_HU, 0, 4000);
  if (body.cortex_HU.value_or(0) > 0 && body.shell_m > 0)
    object.error("cortex_HU", "cannot be given together with a shell");
}

void check_tissue_names(const Scene& scene, JsonErrors& errors) {
  for (std::size_t i = 0; i < scene.slices.size(); ++i) {
    const std::optional<std::string>& wanted = scene.slices[i].tissue;
    if (wanted && std::none_of(scene.tissues.begin(), scene.tissues.end(),
                               [&](const NamedTissue& t) { return t.name == *wanted; }))
      errors.add("/slices/" + std::to_string(i) + "/tissue", "is not in /tissues");
  }
}

void read_tool(StrictObject& object, SceneTool& tool) {
  if (object.has("outline_m")) {
    if (object.has("sides") || object.has("radius_m"))
      object.error("has both outline_m and sides or radius_m");
    tool.outline_m = read_polygon(object, "outline_m", kMaxToolSides, kMaxToolSize_m);
    if (is_clockwise(tool.outline_m)) std::reverse(tool.outline_m.begin(), tool.outline_m.end());
    tool.sides = static_cast<int>(tool.outline_m.size());
  }
  if (object.has("kind")) tool.kind = object.string("kind");
  tool.half_angle_deg = SceneTool::usual_half_angle_deg(tool.kind);
  object.read("half_angle_deg", tool.half_angle_deg, 3.0, 90.0);
  object.read("inner_radius_m", tool.inner_radius_m, 0.0, kMaxToolSize_m);
  tool.sides = static_cast<int>(object.integer("sides", 3, kMaxToolSides, tool.sides));
  object.read("radius_m", tool.radius_m, 1e-4, kMaxToolSize_m);
  object.read("rotation_deg", tool.rotation_deg, -kMaxAngle_deg, kMaxAngle_deg);
  object.read("tilt_deg", tool.tilt_deg, 0.0, kMaxTilt_deg);
  object.read("tilt_azimuth_deg", tool.tilt_azimuth_deg, -kMaxAngle_deg, kMaxAngle_deg);
  object.numbers("tip_in_plate_m", tool.tip_in_plate_m, -0.5, 0.5, false);
}

void read_trajectory(StrictObject& hand, std::vector<TipKeyframe>& trajectory) {
  hand.elements("trajectory", 1, kMaxKeyframes, [&](StrictObject& object) {
    TipKeyframe keyframe;
    keyframe.t_s = object.number("t_s", 0.0, kMaxDuration_s);
    object.numbers("tip_m", keyframe.tip_m, -kMaxPosition_m, kMaxPosition_m, true);
    object.numbers("rotation_deg", keyframe.rotation_deg, -kMaxAngle_deg, kMaxAngle_deg, false);
    if (trajectory.empty() && keyframe.t_s != 0.0) object.error("t_s", "must be 0 in the first");
    if (!trajectory.empty() && !(keyframe.t_s > trajectory.back().t_s))
      object.error("t_s", "must be later than the keyframe before it");
    trajectory.push_back(keyframe);
  });
}

void read_hand(StrictObject& object, SceneHand& hand) {
  object.read("stiffness_N_per_m", hand.stiffness_N_per_m, 0.0, 1e5);
  object.read("damping_N_s_per_m", hand.damping_N_s_per_m, 0.0, 1e4);
  object.read("rotation_stiffness_Nm_per_rad", hand.rotation_stiffness_Nm_per_rad, 0.0, 1e4);
  object.read("rotation_damping_Nm_s_per_rad", hand.rotation_damping_Nm_s_per_rad, 0.0, 1e3);
  object.read("mass_kg", hand.mass_kg, 0.0, 10.0);
  object.read("let_go_t_s", hand.let_go_t_s, 0.0, kMaxDuration_s);
  hand.grip = static_cast<HandGrip>(object.choice("grip", std::array{"firm", "light", "stiff"}));
  read_trajectory(object, hand.trajectory);
  hand.live = object.boolean("live");
  if (!hand.live) return;
  if (hand.trajectory.size() > 1)
    object.error("trajectory", "must have one keyframe, the start, because the hand is live");
  if (hand.let_go_t_s)
    object.error("let_go_t_s", "cannot be combined with live: the person lets go");
}

// A procedure replaces the tool's shape, the tissue and the layers, so the scene must not state them as well.
void read_procedure(StrictObject& object, const nlohmann::json& document, Scene& scene,
                    JsonErrors& errors) {
  const std::string name = object.string("name");
  constexpr std::array kStrengths{"median", "low", "high"};
  const Strength strength =
      *strength_from_string(kStrengths.at(object.choice("strength", kStrengths)));
  const Procedure* procedure = find_procedure(name);
  if (procedure == nullptr) return object.error("name", "must be one of " + procedure_names());
  for (const char* key : {"tissue", "tissues", "layers"})
    if (document.contains(key))
      return errors.add(std::string("/") + key, "cannot be combined with a procedure");
  if (document.contains("tool"))
    for (const char* key :
         {"kind", "half_angle_deg", "inner_radius_m", "sides", "radius_m", "outline_m"})
      if (document.at("tool").contains(key))
        return errors.add(std::string("/tool/") + key, "cannot be combined with a procedure");
  if (errors.first) return;
  if (const auto applied = apply_procedure(*procedure, strength, scene); !applied)
    errors.add("/procedure", applied.error().message);
}

}  // namespace

const ForceLawTraits& traits_of(ForceLawKind law) noexcept {
  return rows()[static_cast<std::size_t>(law)];
}

std::optional<ForceLawKind> force_law_from_string(std::string_view name) noexcept {
  for (std::size_t i = 0; i < rows().size(); ++i) {
    if (name == rows()[i].name) return static_cast<ForceLawKind>(i);
  }
  return std::nullopt;
}

std::string force_law_names(const std::string& quote) {
  std::string names;
  for (std::size_t i = 0; i < rows().size(); ++i) {
    const char* before = i == 0 ? "" : i + 1 < rows().size() ? ", " : " or ";
    names.append(before).append(quote).append(rows()[i].name).append(quote);
  }
  return names;
}

ForceLawKind add_force_law(const ForceLawTraits& traits) {
  rows().push_back(traits);
  return static_cast<ForceLawKind>(rows().size() - 1);
}

Result<Scene> parse_scene(std::string_view text, const std::string& name,
                          const std::filesystem::path& folder) {
  const Result<nlohmann::json> document = parse_strict_json(text, name);
  if (!document) return document.error();
  JsonErrors errors{name, std::nullopt};
  StrictObject object(*document, "", errors);
  Scene scene;
  if (object.string("schema") != kSceneSchema)
    object.error("schema", std::string("must be \"") + kSceneSchema + "\"");
  scene.name = object.string("name");
  scene.asset = folder / object.string("asset");
  if (object.has("device")) scene.device = folder / object.string("device");
  scene.duration_s = object.number("duration_s", 1e-3, kMaxDuration_s);
  object.read("rate_Hz", scene.rate_Hz, kMinRate_Hz, kMaxRate_Hz);
  object.section("placement", [&](StrictObject& o) { read_placement(o, scene.placement); });
  if (object.has("body")) {
    if (object.has("slices")) errors.add("/body", "cannot be combined with slices");
    object.section("body", [&](StrictObject& o) { read_bone_volume(o, scene.body.emplace()); });
  } else {
    read_slices(object, scene.slices);
  }
  if (object.has("layers")) read_layers(object, scene.layers);
  scene.tissue_is_given =
      object.section("tissue", [&](StrictObject& o) { read_tissue(o, scene.tissue); });
  if (object.has("tissues")) read_tissues(object, scene.tissues);
  check_tissue_names(scene, errors);
  object.section("force_law", [&](StrictObject& o) { read_force_law(o, scene.force_law); });
  object.section("tool", [&](StrictObject& o) { read_tool(o, scene.tool); });
  object.required_section("hand", [&](StrictObject& o) { read_hand(o, scene.hand); });
  object.section("goals", [&](StrictObject& o) { read_goals(o, scene.goals.emplace()); });
  object.section("procedure",
                 [&](StrictObject& o) { read_procedure(o, *document, scene, errors); });
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
