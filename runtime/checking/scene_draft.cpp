// SPDX-License-Identifier: Apache-2.0
#include "runtime/checking/scene_draft.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>
#include <system_error>
#include <utility>

#include "formats/base/json_text.h"
#include "formats/session/scene.h"
#include "runtime/bone_cutting/material/bone_volume.h"

namespace trocar::runtime {
namespace {

using Eigen::Vector3d;
using Json = nlohmann::ordered_json;  // ordered, because people read scenes

// Length of the path above the bone, below the last slice, and below a target.
constexpr double kAbove_m = 0.006, kBelow_m = 0.013, kBelowTarget_m = 0.008;
// Distance of slices at which each is felt separately: a puncture takes 7 mm.
constexpr double kApart_m = 0.0095;
constexpr std::size_t kMaxSlices = 5;
// The goals of a path that a person has chosen.
constexpr double kTargetRadius_m = 0.002, kCorridor_m = 0.003;

std::string text_of(const Json& scene) {
  return json_text(scene, 2) + "\n";
}

Json rounded_point(const Vector3d& at_m) {
  Json point = Json::array();
  for (const double x : at_m) {
    const double value = rounded(x, 1e5);
    point.push_back(value == 0 ? Json(0) : Json(value));
  }
  return point;
}

}  // namespace

std::vector<std::size_t> separable_levels(const std::vector<Level>& levels,
                                          const NeedlePath& path) {
  std::vector<std::size_t> felt;
  for (std::size_t i = path.first; i <= path.last && felt.size() < kMaxSlices; ++i) {
    if (path.has_material[i] == 0) continue;
    if (felt.empty() || levels[felt.back()].z_mm - levels[i].z_mm >= 1e3 * kApart_m)
      felt.push_back(i);
  }
  return felt;
}

double height_outside_bone_m(const NeedlePath& path) {
  return kAbove_m + (path.has_target ? kBelowTarget_m : kBelow_m);
}

SceneDraft::SceneDraft(const std::vector<Level>& asset_levels, const NeedlePath& needle_path,
                       bool has_chosen_path, WorkspaceHeights tip_heights)
    : levels(asset_levels), path(needle_path), is_chosen(has_chosen_path), heights(tip_heights) {
  anchor_mm = (path.entry_mm + path.end_mm).head<2>() / 2;
  for (double& x : anchor_mm)
    x = rounded(x, 100);
  // The path is in the middle of the heights.
  const double used_m = 1e-3 * (path.entry_mm.z() - path.end_mm.z()) + height_outside_bone_m(path);
  const double free_m = heights.max_m - heights.min_m - used_m;
  entry_z_m = rounded(heights.max_m - kAbove_m - std::max(0.0, free_m) / 2, 1e4);
}

void SceneDraft::name_files(const std::filesystem::path& asset_file,
                            const std::filesystem::path& scene_file) {
  std::error_code failed;
  std::filesystem::path folder = scene_file.parent_path();
  if (folder.empty()) folder = ".";
  std::filesystem::path asset = std::filesystem::relative(asset_file, folder, failed);
  const bool is_outside = asset.empty() || *asset.begin() == "..";
  if (asset_file.is_absolute() && is_outside) asset = asset_file;
  if (failed || asset.empty()) asset = std::filesystem::absolute(asset_file, failed);
  asset_name = asset.generic_string();
  scene_name = "Proposed for " + asset_file.filename().string();
}

Vector3d SceneDraft::to_device(const Vector3d& at_mm) const {
  const Eigen::Vector2d xy_m = 1e-3 * (at_mm.head<2>() - anchor_mm);
  return {xy_m.x(), xy_m.y(), entry_z_m + 1e-3 * (at_mm.z() - path.entry_mm.z())};
}

double SceneDraft::height_m(std::size_t level) const {
  return entry_z_m + 1e-3 * (levels[level].z_mm - path.entry_mm.z());
}

namespace {

Json head(const SceneDraft& d) {
  return {{"schema", kSceneSchema},
          {"name", d.scene_name},
          {"asset", d.asset_name},
          {"placement", {{"anchor_mm", {d.anchor_mm.x(), d.anchor_mm.y()}}}}};
}

Json goals(const SceneDraft& d) {
  Json line = {{"entry_m", rounded_point(d.to_device(d.path.entry_mm))}};
  if (!d.path.has_target) line["direction"] = rounded_point(d.path.direction);
  line["entry_radius_m"] = line["corridor_m"] = kCorridor_m;
  Json goals;
  if (d.path.has_target)
    goals["target"] = {{"at_m", rounded_point(d.to_device(d.path.end_mm))},
                       {"radius_m", kTargetRadius_m}};
  goals["line"] = std::move(line);
  return goals;
}

Json keyframe(const NeedlePath& path, double t_s, const Vector3d& tip_m) {
  Json key = {{"t_s", rounded(t_s, 1e3)}, {"tip_m", rounded_point(tip_m)}};
  const double angle_deg = tilt_deg(path);
  if (!(angle_deg > 0)) return key;
  const Vector3d axis = (-Vector3d::UnitZ()).cross(path.direction).normalized();
  Json rotation = Json::array();
  for (const double x : axis)
    rotation.push_back(rounded(x * angle_deg, 1e3));
  key["rotation_deg"] = std::move(rotation);
  return key;
}

Json hand(const SceneDraft& d, double speed_m_per_s, bool returns, Json& scene) {
  constexpr double kRest_s = 0.2;
  const Vector3d& along = d.path.direction;
  const Vector3d from_m = d.to_device(d.path.entry_mm) + kAbove_m / along.z() * along;
  const double below_m = d.path.has_target ? d.beyond_target_m : kBelow_m;
  const Vector3d to_m = d.to_device(d.path.end_mm) - below_m / along.z() * along;
  const double length_m = (to_m - from_m).norm();
  const double down_s = kRest_s + length_m / speed_m_per_s;
  Json keys = {keyframe(d.path, 0, from_m), keyframe(d.path, kRest_s, from_m),
               keyframe(d.path, down_s, to_m)};
  double end_s = down_s + 0.3;
  if (returns) {
    keys.push_back(keyframe(d.path, down_s + 0.5, to_m));
    end_s = down_s + 0.5 + length_m / speed_m_per_s / 1.5;
    keys.push_back(keyframe(d.path, end_s, from_m));
    end_s += 0.2;
  }
  scene["duration_s"] = rounded(end_s, 100);
  Json hand = {{"stiffness_N_per_m", 8000}, {"damping_N_s_per_m", 140}};
  if (d.has_live_hand) {
    hand["trajectory"] = Json::array({keys[0]});
    hand["live"] = true;
    scene["duration_s"] = 600;
  } else {
    hand["trajectory"] = std::move(keys);
  }
  return hand;
}

}  // namespace

std::string SceneDraft::cutting(double force_scale) const {
  Json scene = head(*this);
  std::size_t first = path.first, last = path.last;
  // All bone near a chosen path is there, because a person may leave it, or stop in the bone.
  const auto is_joined = [&](std::size_t above) {
    return levels[above].z_mm - levels[above + 1].z_mm <=
           1e3 * (kMaxSlabGap_m + kSlabGapRounding_m);
  };
  const auto fits = [&](std::size_t from, std::size_t to) {
    return slices_between(levels[from], levels[to]) <= kMaxSceneSlices;
  };
  while (is_chosen && last + 1 < levels.size() && is_joined(last) &&
         height_m(last + 1) >= heights.min_m && fits(first, last + 1))
    ++last;
  while (is_chosen && first > 0 && is_joined(first - 1) && height_m(first - 1) <= heights.max_m &&
         fits(first - 1, last))
    --first;
  const int a = levels[first].slice->index, b = levels[last].slice->index;
  scene["body"] = {
      {"from", std::min(a, b)}, {"to", std::max(a, b)}, {"top_z_m", rounded(height_m(first), 1e7)}};
  scene["tissue"] = {{"cut",
                      {{"bone", {{"law", "kopperdahl-power"}}},
                       {"tearing_N_per_m", 500},
                       {"friction_kPa", 60},
                       {"bed_N_per_mm3", 30},
                       {"lateral_strength_MPa", 5}}}};
  scene["force_law"] = {{"kind", "cutting"}, {"force_scale", force_scale}};
  scene["tool"] = {{"sides", 12}, {"radius_m", kNeedleRadius_m}};
  scene["hand"] = hand(*this, 0.0115, true, scene);
  if (is_chosen) scene["goals"] = goals(*this);
  return text_of(scene);
}

std::string SceneDraft::sheets(double threshold_N, double share) const {
  Json scene = head(*this);
  scene["slices"] = Json::array();
  for (const std::size_t level : separable_levels(levels, path))
    scene["slices"].push_back(
        {{"index", levels[level].slice->index}, {"z_m", rounded(height_m(level), 1e7)}});
  scene["tissue"] = {{"stiffness_N_per_m", 5000}, {"threshold_N", threshold_N}};
  scene["force_law"] = {{"kind", "hooke"}};
  if (share < 1) scene["force_law"]["force_scale"] = std::floor(1e3 * share) / 1e3;
  scene["tool"] = {{"sides", 6}, {"radius_m", kPaperToolRadius_m}};
  scene["hand"] = hand(*this, 0.0175, false, scene);
  if (is_chosen) scene["goals"] = goals(*this);
  return text_of(scene);
}

}  // namespace trocar::runtime
