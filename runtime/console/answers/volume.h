// SPDX-License-Identifier: Apache-2.0
// Encodes the HU of a scene's scan, and their positions in {B}, the device's frame. The console's
// page makes X-ray pictures and planes of the CT from them.
#pragma once

#include <filesystem>
#include <string>

#include "formats/base/result.h"

namespace trocar::runtime {

/// Returns the answer of /api/volume (protocol.md). If `asset` is not empty, it replaces the asset
/// that the scene names. Errors: those of load_bone() (placed_bone.h).
Result<std::string> volume_of(const std::filesystem::path& scene_file,
                              const std::filesystem::path& asset);

}  // namespace trocar::runtime
