// SPDX-License-Identifier: Apache-2.0
#include "formats/scene.h"

#include <algorithm>
#include <cmath>
#include <span>

#include "formats/file_io.h"
#include "formats/strict_json.h"

namespace trocar {
namespace {

constexpr std::uint64_t kMaxSceneBytes = std::uint64_t{4} << 20;
constexpr double kMaxPosition_m = 1.0;    // of anything in the device's frame
constexpr double kMaxAnchor_mm = 4096.0;  // keeps lattice coordinates far below kMaxCoordinate
constexpr double kMaxAngle_deg = 360.0;

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
    object.finish();
    for (std::size_t j = 0; j < slices.size(); ++j) {
      if (std::abs(slices[j].z_m - slice.z_m) < kMinSliceGap_m) {
        errors.add(object.path("z_m"), "is within 0.1 mm of /slices/" + std::to_string(j));
      }
    }
    slices.push_back(slice);
  }
}

Tissue read_tissue(const nlohmann::json& value, JsonErrors& errors) {
  StrictObject object(value, "/tissue", errors);
  Tissue tissue;
  tissue.stiffness_N_per_m = object.number("stiffness_N_per_m", 1.0, 1e5, tissue.stiffness_N_per_m);
  tissue.threshold_N = object.number("threshold_N", 0.01, 1000.0, tissue.threshold_N);
  tissue.damping_N_s_per_m =
      object.number("damping_N_s_per_m", 0.0, 1000.0, tissue.damping_N_s_per_m);
  object.finish();
  return tissue;
}

SceneTool read_tool(const nlohmann::json& value, JsonErrors& errors) {
  StrictObject object(value, "/tool", errors);
  SceneTool tool;
  tool.sides = static_cast<int>(object.integer("sides", 3, kMaxToolSides, tool.sides));
  tool.radius_m = object.number("radius_m", 1e-4, 0.05, tool.radius_m);
  tool.rotation_deg = object.number("rotation_deg", -kMaxAngle_deg, kMaxAngle_deg, 0.0);
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
  if (const nlohmann::json* frames = object.array("trajectory", 1, kMaxKeyframes)) {
    for (std::size_t i = 0; i < frames->size(); ++i) {
      StrictObject frame((*frames)[i], object.path("trajectory") + "/" + std::to_string(i), errors);
      TipKeyframe keyframe;
      keyframe.t_s = frame.number("t_s", 0.0, kMaxDuration_s);
      frame.numbers("tip_m", keyframe.tip_m, -kMaxPosition_m, kMaxPosition_m, true);
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

void read_force_law(const nlohmann::json& value, JsonErrors& errors) {
  StrictObject object(value, "/force_law", errors);
  if (object.string("kind") != "hooke") errors.add(object.path("kind"), "must be \"hooke\"");
  object.finish();
}

}  // namespace

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
  if (const auto* value = object.array("slices", 1, kMaxSceneSlices)) {
    read_slices(*value, errors, scene.slices);
  }
  if (const auto* value = object.optional_value("tissue")) {
    scene.tissue = read_tissue(*value, errors);
  }
  if (const auto* value = object.optional_value("force_law")) read_force_law(*value, errors);
  if (const auto* value = object.optional_value("tool")) scene.tool = read_tool(*value, errors);
  if (const auto* value = object.optional_value("hand")) {
    scene.hand = read_hand(*value, errors);
  } else {
    errors.add(object.path("hand"), "is missing");
  }
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
