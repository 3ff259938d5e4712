// SPDX-License-Identifier: Apache-2.0
// A scene's bone in {B} for display: sheets, and the asset's surface where its place is defined.
#pragma once

#include <filesystem>
#include <string>

#include "formats/base/result.h"

namespace trocar::runtime {

/// The answer of /api/bone (protocol.md). `asset`, if not empty, instead of the scene's. Refused as
/// trocar-run does.
Result<std::string> bone_of(const std::filesystem::path& scene_file,
                            const std::filesystem::path& asset);

}  // namespace trocar::runtime
