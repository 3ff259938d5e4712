// SPDX-License-Identifier: Apache-2.0
// Proposes a scene for an asset (`trocar-run --new-scene`). The tool enters where the bone is
// thickest, or goes through points that a person has chosen. Slices are placed at heights that the
// device's tip can reach.
// Tests: tests/runtime/checking/scene_check_test.cpp, tests/e2e/new_scene_test.py
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

#include "formats/asset/asset.h"
#include "formats/base/result.h"
#include "runtime/checking/dry_run.h"
#include "runtime/checking/needle_path.h"
#include "runtime/session/session_options.h"

namespace trocar::runtime {

struct NewScene {
  std::string json;  ///< the scene (scene.schema.json), with a line feed at its end
  std::string text;  ///< reasons for the choice, in one line
};

enum class NewSceneHand : std::uint8_t { kScripted, kLive };

struct NewSceneChoices {
  NewSceneHand hand = NewSceneHand::kScripted;
  std::optional<ChosenPoints> points;  ///< none: the needle enters where the bone is thickest
};

/// Proposes a scene. `asset` was read from `asset_file` and has been through weld_materials(). The
/// scene will be written to `scene_file`. First the force law `cutting` is tried, through one bone volume with a strength
/// computed from HU; it needs HU in every slice with material, and slices at most 3 mm apart. If that does not apply, or each such
/// proposal has a warning, `hooke` is tried, with slices far enough apart for each to be felt separately. Slices are at
/// their true spacing. Proposals are checked one after another, as `--check --strict` would with `options`; the first that
/// has no warning and punctures a slice is returned. If `choices.hand` is kLive, the hand's trajectory is then replaced by
/// a live hand at its first pose, and the scene is checked again. With chosen points the scene has goals for them. If there is a target
/// and the hand is scripted, the tip must end within 1.5 mm of the target's height. If no proposal through chosen points is free of
/// warnings, the one with the fewest is returned. Errors: (refused, with the reason) the asset is empty, two of its slices are
/// less than 0.1 mm apart, its bone is nowhere as wide as the tool, or `options.stop` was set; without chosen points: every
/// proposal has a warning; with chosen points: no needle can take the path (needle_path.h), the device cannot turn or move so
/// far, or no scene along it runs.
Result<NewScene> propose_scene(const Asset& asset, const std::filesystem::path& asset_file,
                               const std::filesystem::path& scene_file, const DeviceToCheck& device,
                               const SessionOptions& options, const NewSceneChoices& choices = {});

}  // namespace trocar::runtime
