// SPDX-License-Identifier: Apache-2.0
// Finds the tissue of each slice, and states the reason in words.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "formats/asset/asset.h"
#include "formats/base/result.h"
#include "formats/session/scene.h"
#include "runtime/check/dry_run.h"
#include "runtime/check/needle_path.h"
#include "runtime/haptics/slice_field.h"
#include "runtime/session/pose_session.h"
#include "runtime/session/session_options.h"

namespace trocar::runtime {

/// Returns a text such as "slice 3" or "slices 0-46, 50", with each slice once, in ascending order.
std::string name_slices(std::vector<int> slices);

struct SliceTissue {
  int slice = 0;  ///< slice index in the asset
  double z_m = 0;
  TissueChoice choice;
};

/// Returns the tissue of every slice of the scene, the topmost first as in place_slices(). Slices
/// that the asset does not have are left out.
std::vector<SliceTissue> choose_tissues(const Scene& scene, const Asset& asset);

/// Returns a text such as: tissue "bone": mean HU 412.
std::string describe_choice(const Scene& scene, const TissueChoice& choice);

/// Returns a warning if some slice gets Trocar's default tissue although the scene gives tissues by
/// label or HU. That happens if none of these tissues fits the slice, and the scene has no `tissue`
/// for the remaining slices.
std::optional<std::string> warn_of_unfitting(const Scene& scene,
                                             const std::vector<SliceTissue>& tissues);

// Drafts of scenes for a needle's path, as JSON. A draft is not checked here. propose_scene()
// (new_scene.h) checks the drafts and chooses one.

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

// Proposes a scene for an asset (`trocar-run new-scene`). The tool enters where the bone is
// thickest, or goes through points that a person has chosen. Slices are placed at heights that the
// device's tip can reach.

struct NewScene {
  std::string json;  ///< the scene (scene.schema.json), with a line feed at its end
  /// One line that says why this scene was chosen. If the scene has the law `hooke`, the line also
  /// says why no scene with the law `cutting` was chosen.
  std::string text;
};

struct NewSceneChoices {
  bool has_live_hand = false;          ///< false: the hand is scripted
  std::optional<ChosenPoints> points;  ///< none: the needle goes through the thickest bone
};

/// Proposes a scene. Precondition: `asset` was read from `asset_file`, and weld_materials() has
/// joined the materials of each slice. `scene_file`: the file to which the caller will write the
/// scene. The folder of this file determines how the scene names the asset, as
/// SceneDraft::name_files() describes.
///  - Candidates: the function makes several scenes, the candidates. The first ones have the force
///    law `cutting`, in which the slices are one bone volume whose strength is computed from HU.
///    They are made only if every slice with material has HU and slices are at most 3 mm apart. A
///    volume has at most kMaxSceneSlices slices. So a path without a target ends after this number
///    of slices. If a path to a target goes through more slices, the candidates with the law
///    `cutting` are not made. The next candidates have the law `hooke`. They leave out slices, so
///    that the remaining slices are at least 9.5 mm apart and each puncture is felt separately. In
///    all candidates the distances between slices are those of the scan.
///  - Choice: the candidates are checked one after another, as `check --strict` with `options`
///    would do. The first candidate that has no warning and punctures a slice is returned.
///  - Live hand: if `choices.has_live_hand` is true, a candidate is checked twice, first with a
///    scripted hand, then with a live hand that starts at the first pose of the scripted hand. The
///    scene that is returned has the live hand.
///  - Chosen points: the scene has goals for the points. If there is a target and the hand is
///    scripted, the lowest height of the tip must be within 1.5 mm of the target's height. If every
///    candidate has a warning, the one with the fewest warnings is returned.
/// Errors: kRefused if no slice of the asset has material, if two slices are less than 0.1 mm
/// apart, if the bone is nowhere as wide as the tool, if the tip of the device's tool can reach no
/// point. kDeviceFault
/// if `options.stop` was set. Without chosen points, the error is also kRefused if every
/// candidate is refused, has a warning or punctures no slice. With chosen points, the error is also
/// kRefused if no needle can take the path (needle_path.h), if the device cannot turn or move as
/// far as the path requires, or if every candidate is refused, punctures no slice or leaves the tip
/// too far from the target.
Result<NewScene> propose_scene(const Asset& asset, const std::filesystem::path& asset_file,
                               const std::filesystem::path& scene_file, const DeviceToCheck& device,
                               const SessionOptions& options, const NewSceneChoices& choices = {});

}  // namespace trocar::runtime
