// SPDX-License-Identifier: Apache-2.0
// The bone of a scene in {B}, for display: the sheets, and the asset's surface if its
// position is defined.
// Tests: tests/e2e/console_server_test.py
#pragma once

#include <filesystem>
#include <string>

#include "formats/base/result.h"

namespace trocar::runtime {

/// Returns the answer of /api/bone (protocol.md). If `asset` is not empty, it replaces the scene's
/// own asset. Errors: (refused) what trocar-run refuses.
Result<std::string> bone_of(const std::filesystem::path& scene_file,
                            const std::filesystem::path& asset);

}  // namespace trocar::runtime
