// SPDX-License-Identifier: Apache-2.0
// Proposes a scene for an asset (`trocar-run --new-scene`). The tool enters where the bone is
// thickest, or goes through points that a person has chosen. Slices lie within the device's workspace.
// Tests: tests/runtime/checking/scene_check_test.cpp, tests/e2e/new_scene_test.py
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

#include "formats/asset/asset.h"
#include "formats/base/result.h"
#include "runtime/checking/dry_run.h"
#include "runtime/checking/needle_way.h"
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
/// scene will be written to `scene_file`. If the asset has HU and its slices are at most 3 mm apart,
/// the force law is `cutting` through one bone volume, with slices at their true spacing and strength
/// by HU. Otherwise the force law is `hooke`, with slices far enough apart for each to be felt
/// separately. Proposals are checked in turn, as `--check --strict` does with `options`, until one
/// has no warning and a slice is punctured. If `choices.hand` is kLive, that scene's path is then replaced
/// by a live hand at its start, and the result is checked once more. With chosen points the scene has them as its goals; a
/// scripted hand brings the tip to within 1.5 mm of the target's height, and of the proposals that puncture a slice the one
/// with the fewest warnings is returned. Errors: (refused, with the reason) the asset is empty, its bone is nowhere as wide as
/// the tool, every proposal has a warning although no points were chosen, no needle can go through the chosen points
/// (needle_way.h), or the device cannot turn or move so far.
Result<NewScene> propose_scene(const Asset& asset, const std::filesystem::path& asset_file,
                               const std::filesystem::path& scene_file, const DeviceToCheck& device,
                               const SessionOptions& options, const NewSceneChoices& choices = {});

}  // namespace trocar::runtime
