// SPDX-License-Identifier: Apache-2.0
// A scene for an asset that has none (`trocar-run --new-scene`): where its bone is thickest, at the
// slices' true spacing, within the device's reach.
#pragma once

#include <filesystem>
#include <string>

#include "formats/asset/asset.h"
#include "formats/base/result.h"
#include "formats/session/device_description.h"
#include "runtime/session/session.h"

namespace trocar::runtime {

struct NewScene {
  std::string json;  ///< of formats/session/scene.schema.json, with a line feed at its end
  std::string text;  ///< what was chosen and why: one paragraph, one line
};

/// `asset` as weld_materials() leaves it, read from `asset_file`; the scene is to be `scene_file`.
/// With HU and slices at most 3 mm apart the law is `cutting` through one body, strength by HU;
/// else `hooke` with slices far enough apart for each to be felt. Each proposal is tried as
/// `--check --strict` does, with `options`, until one has no warning and is punctured.
/// Refused, with the reason: no material, no place as wide as the tool, no proposal that is without
/// a warning.
Result<NewScene> propose_scene(const Asset& asset, const std::filesystem::path& asset_file,
                               const std::filesystem::path& scene_file,
                               const DeviceDescription& device, const SessionOptions& options);

}  // namespace trocar::runtime
