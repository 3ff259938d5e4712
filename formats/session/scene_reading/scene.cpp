// SPDX-License-Identifier: Apache-2.0
#include "formats/session/scene.h"

#include <algorithm>
#include <cmath>

#include "formats/base/file_io.h"
#include "formats/base/strict_json.h"
#include "formats/session/procedures.h"
#include "formats/session/scene_reading/scene_readers.h"

namespace trocar {
namespace {

constexpr std::uint64_t kMaxSceneBytes = std::uint64_t{4} << 20;
constexpr double kMaxAnchor_mm = 4096.0;  // keeps lattice coordinates far below kMaxCoordinate
constexpr double kMaxAngle_deg = 360.0;
constexpr double kMaxToolSize_m = 0.05;
constexpr int kMaxSliceIndex = 1'000'000;
// Tolerance for the rounding errors of two heights and of their difference, together 4e-16 m.
constexpr double kRounding_m = 1e-12;

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
