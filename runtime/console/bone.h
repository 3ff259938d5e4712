// SPDX-License-Identifier: Apache-2.0
// A scene's bone in {B} for display: its sheets, and the asset's surface if its
// position is defined.
// Tests: tests/e2e/console_server_test.py
#pragma once

#include <filesystem>
#include <string>

#include "formats/base/result.h"

namespace trocar::runtime {

/// The answer of /api/bone (protocol.md). An `asset` that is not empty replaces the scene's own.
/// Refused: what trocar-run refuses.
Result<std::string> bone_of(const std::filesystem::path& scene_file,
                            const std::filesystem::path& asset);

}  // namespace trocar::runtime
