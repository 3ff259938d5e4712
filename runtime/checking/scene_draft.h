// SPDX-License-Identifier: Apache-2.0
// Drafts of scenes for a needle's path, as JSON. A draft is not checked here. propose_scene()
// (new_scene.h) checks the drafts and chooses one.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "runtime/checking/needle_path.h"
#include "runtime/devices/tip_workspace.h"

namespace trocar::runtime {

/// Radius of the tool: kNeedleRadius_m in the scene of SceneDraft::cutting(), kPaperToolRadius_m in
/// the scene of SceneDraft::sheets().
inline constexpr double kNeedleRadius_m = 0.0015, kPaperToolRadius_m = 0.003;

/// The hand's motion begins above the entry of a path and reaches below the path's end. Returns the
/// sum of these two additional heights in m.
double height_outside_bone_m(const NeedlePath& path);

/// Returns the indices of at most 5 levels at which the path goes through material, from the top
/// down. The levels are at least 9.5 mm apart, so that each puncture is felt separately.
std::vector<std::size_t> separable_levels(const std::vector<Level>& levels, const NeedlePath& path);

struct SceneDraft {
  /// `levels` and `path` must outlive the draft.
  SceneDraft(const std::vector<Level>& asset_levels, const NeedlePath& needle_path,
             bool has_chosen_path, WorkspaceHeights tip_heights);

  /// Sets the scene's name, and the file name by which the scene names the asset. This file name is
  /// relative to the scene's folder, unless `asset_file` is absolute and lies outside that folder.
  void name_files(const std::filesystem::path& asset_file, const std::filesystem::path& scene_file);

  /// Returns a scene with one bone volume, made of the levels along the path, with a strength
  /// computed from HU, and with a hand that moves in along the path and back out. `force_scale`:
  /// the scene's factor on the tissue's forces.
  std::string cutting(double force_scale) const;
  /// Returns a scene with a single sheet at each of separable_levels(). `threshold_N`: puncture
  /// threshold of the tissue. `share`: the fraction of `threshold_N` that the device can render. If
  /// this fraction is below 1, it becomes the scene's factor on the tissue's forces.
  std::string sheets(double threshold_N, double share) const;

  Eigen::Vector3d to_device(const Eigen::Vector3d& at_mm) const;
  double height_m(std::size_t level) const;  ///< height of a level in {B}

  const std::vector<Level>& levels;  ///< the levels of the asset, the topmost first
  const NeedlePath& path;
  /// A person has chosen the path. It is then a goal of the scene, and so is the target if there is
  /// one. The scene's bone volume then also includes the connected slices above and below the path.
  bool is_chosen;
  WorkspaceHeights heights;  ///< heights of the tip in {B} that the draft may use
  std::string asset_name, scene_name;
  Eigen::Vector2d anchor_mm = Eigen::Vector2d::Zero();
  double entry_z_m = 0;  ///< height of the entry in {B}
  /// The path of the scripted hand ends this far below the target (negative: above). This
  /// compensates for the tip's lag behind the hand. Without a target this has no effect.
  double beyond_target_m = 0;
  /// The scenes have a live hand, which begins at the pose where the scripted hand would begin.
  bool has_live_hand = false;
};

}  // namespace trocar::runtime
