// SPDX-License-Identifier: Apache-2.0
// Drafts of scenes for a needle's path, as JSON. Nothing is checked here; new_scene.h tries the drafts.
// Tests: tests/e2e/new_scene_test.py, tests/e2e/chosen_points_test.py
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "runtime/checking/needle_path.h"
#include "runtime/devices/tip_workspace.h"

namespace trocar::runtime {

inline constexpr double kNeedleRadius_m = 0.0015,
                        kPaperToolRadius_m = 0.003;  ///< radii of the tools of drafts

/// Returns how far in m the hand moves above the entry and below the end of the path, both together.
double height_outside_bone_m(const NeedlePath& path);

/// Returns the indices of at most 5 levels, from the top down, at which the path goes through material, and which are so far apart
/// (9.5 mm) that each puncture is felt separately.
std::vector<std::size_t> separable_levels(const std::vector<Level>& levels, const NeedlePath& path);

class SceneDraft {
 public:
  /// `levels`: of the asset, the topmost first. `is_chosen`: a person has chosen the path. The scene then has goals for it, and its
  /// bone volume includes the connected slices above and below. `heights`: those of the tip in {B} that the draft may use. Levels and path must outlive the draft.
  SceneDraft(const std::vector<Level>& levels, const NeedlePath& path, bool is_chosen,
             WorkspaceHeights heights);

  /// Sets the scene's name, and the asset's file name in it: relative to the scene's folder, except that an absolute name of a file
  /// outside of that folder stays absolute.
  void name_files(const std::filesystem::path& asset_file, const std::filesystem::path& scene_file);
  /// Sets the height by which the scripted hand's path ends below the target, because the tip lags behind the hand. It may be
  /// negative, and has no effect without a target.
  void set_overshoot(double beyond_target_m) { beyond_target_m_ = beyond_target_m; }

  /// Gives the scenes a live hand, which begins where the scripted one does.
  void set_live_hand() { has_live_hand_ = true; }

  /// A scene with one bone volume of the levels around the path, with a strength computed from HU, and a hand that goes in and out.
  std::string cutting(double force_scale) const;
  /// A scene with a single sheet at each of separable_levels(). `share`: the fraction of the force that the device can render; below 1
  /// it becomes the force scale.
  std::string sheets(double threshold_N, double share) const;
  bool has_target() const { return path_.has_target; }
  /// The height of the target in {B}, in m; the path must have one.
  double target_z_m() const { return to_device(path_.end_mm).z(); }

 private:
  class Writer;

  Eigen::Vector3d to_device(const Eigen::Vector3d& at_mm) const;
  double height_m(std::size_t level) const;

  const std::vector<Level>& levels_;
  const NeedlePath& path_;
  bool is_chosen_;
  WorkspaceHeights heights_;
  std::string asset_name_, scene_name_;
  Eigen::Vector2d anchor_mm_ = Eigen::Vector2d::Zero();
  double entry_z_m_ = 0;  ///< height of the entry in {B}
  double beyond_target_m_ = 0;
  bool has_live_hand_ = false;
};

}  // namespace trocar::runtime
