// SPDX-License-Identifier: Apache-2.0
// A recording for playback.
#pragma once

#include <filesystem>
#include <string>

#include "formats/base/result.h"

namespace trocar::runtime {

/// The answer of /api/recording (protocol.md). Refused as trocar-run --replay does, and beyond 2
/// GB.
Result<std::string> rows_of(const std::filesystem::path& recording);

}  // namespace trocar::runtime
