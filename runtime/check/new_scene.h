// SPDX-License-Identifier: Apache-2.0
// Proposes a scene for an asset (`trocar-run new-scene`). The tool enters where the bone is
// thickest, or goes through points that a person has chosen. Slices are placed at heights that the
// device's tip can reach.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "formats/asset/asset.h"
#include "formats/base/result.h"
#include "runtime/check/dry_run.h"
#include "runtime/check/needle_path.h"
#include "runtime/session/session_options.h"

namespace trocar::runtime {

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
/// scene. The scene names the asset relative to the folder of this file, unless `asset_file` is
/// absolute and lies outside that folder.
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
