// SPDX-License-Identifier: Apache-2.0
// Drafts of the scene along a needle's way, as JSON. Nothing is checked here; new_scene.h tries the drafts.
// Tests: tests/e2e/new_scene_test.py
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "formats/asset/asset.h"
#include "runtime/checking/needle_way.h"

namespace trocar::runtime {

inline constexpr double kNeedle_m = 0.0015, kPaperTool_m = 0.003;  ///< radii of the tools of drafts

/// The heights of the tip that a draft may use.
struct DraftHeights {
  double low_m = 0, high_m = 0;
};
/// The height that a way uses beyond the bone that it goes through, for the hand's path above and below.
double height_beside_bone_m(const NeedleWay& way);

/// Returns the levels of a way that have material there and are far enough apart for each to be felt separately; at most 5.
std::vector<std::size_t> felt_levels(const std::vector<Level>& levels, const NeedleWay& way);

class SceneDraft {
 public:
  using Json = nlohmann::ordered_json;  // ordered, because people read scenes

  /// `levels`: of the asset, the topmost first. `is_chosen`: a person has chosen the way, so that it becomes the goal. The asset,
  /// the levels and the way must outlive the draft.
  SceneDraft(const Asset& asset, const std::vector<Level>& levels, const NeedleWay& way,
             bool is_chosen, DraftHeights heights);

  /// Names the asset, relative to the folder of the scene unless its own name is absolute.
  void name_files(const std::filesystem::path& asset_file, const std::filesystem::path& scene_file);
  /// How much farther than the target the scripted hand goes, because the needle stays behind it. Without a target it has no effect.
  void set_reach(double beyond_target_m) { beyond_target_m_ = beyond_target_m; }

  /// A scene with one bone volume of the levels around the way, strength by HU, and a hand that goes in and out.
  Json cutting(double force_scale) const;
  /// A scene with a single sheet at each of felt_levels(). `share`: of a force that the device renders.
  Json sheets(double threshold_N, double share) const;
  bool has_target() const { return way_.has_target; }
  /// The height of the target in {B}, in m; the way must have one.
  double target_z_m() const { return to_device(way_.end_mm).z(); }

 private:
  Json head() const;
  Json goals() const;
  Json hand(double speed_m_per_s, bool returns, Json& scene) const;
  Json keyframe(double t_s, const Eigen::Vector3d& tip_m) const;
  Eigen::Vector3d to_device(const Eigen::Vector3d& at_mm) const;
  double height_m(std::size_t level) const;

  const Asset& asset_;
  const std::vector<Level>& levels_;
  const NeedleWay& way_;
  bool is_chosen_;
  DraftHeights heights_;
  std::string asset_name_, scene_name_;
  Eigen::Vector2d anchor_mm_ = Eigen::Vector2d::Zero();
  double entry_z_m_ = 0;  ///< height of the entry in {B}
  double beyond_target_m_ = 0;
};

}  // namespace trocar::runtime
