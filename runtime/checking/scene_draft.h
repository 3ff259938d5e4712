// SPDX-License-Identifier: Apache-2.0
// Drafts of scenes for a needle's path, as JSON. A draft is not checked here. propose_scene()
// (new_scene.h) checks the drafts and chooses one.
// Tests: tests/e2e/new_scene_test.py, tests/e2e/chosen_points_test.py
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "runtime/checking/needle_path.h"
#include "runtime/devices/tip_workspace.h"

namespace trocar::runtime {

/// Radius of the tool in SceneDraft::cutting(), and in SceneDraft::sheets().
inline constexpr double kNeedleRadius_m = 0.0015, kPaperToolRadius_m = 0.003;

/// Returns the height in m that the hand's motion needs in addition to the path: above the entry
/// and below the end of the path, together.
double height_outside_bone_m(const NeedlePath& path);

/// Returns the indices of at most 5 levels at which the path goes through material, from the top
/// down. The levels are at least 9.5 mm apart, so that each puncture is felt separately.
std::vector<std::size_t> separable_levels(const std::vector<Level>& levels, const NeedlePath& path);

class SceneDraft {
 public:
  /// `levels`: the levels of the asset, the topmost first. `is_chosen`: a person has chosen the
  /// path. The scene then has goals for the path, and its bone volume includes connected slices
  /// above and below the path. `heights`: heights of the tip in {B} that the draft may use. Levels
  /// and path must outlive the draft.
  SceneDraft(const std::vector<Level>& levels, const NeedlePath& path, bool is_chosen,
             WorkspaceHeights heights);

  /// Sets the scene's name, and the path by which the scene names the asset. This path is relative
  /// to the scene's folder. Only an absolute path to a file outside that folder stays absolute.
  void name_files(const std::filesystem::path& asset_file, const std::filesystem::path& scene_file);
  /// Sets the height by which the scripted hand's path ends below the target, because the tip lags
  /// behind the hand. The height may be negative. Without a target this call has no effect.
  void set_overshoot(double beyond_target_m) { beyond_target_m_ = beyond_target_m; }

  /// Gives the scenes a live hand, which begins at the pose where the scripted hand would begin.
  void set_live_hand() { has_live_hand_ = true; }

  /// Returns a scene with one bone volume, made of the levels along the path, with a strength
  /// computed from HU, and with a hand that goes in and out.
  std::string cutting(double force_scale) const;
  /// Returns a scene with a single sheet at each of separable_levels(). `threshold_N`: puncture
  /// threshold of the tissue. `share`: the fraction of this force that the device can render. A
  /// share below 1 becomes the scene's force scale.
  std::string sheets(double threshold_N, double share) const;
  bool has_target() const { return path_.has_target; }
  /// Returns the height of the target in {B}, in m. Precondition: the path has a target.
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
