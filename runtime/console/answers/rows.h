// SPDX-License-Identifier: Apache-2.0
// Encodes a recording for playback on a page.
#pragma once

#include <filesystem>
#include <string>

#include "formats/base/result.h"

namespace trocar::runtime {

/// Returns the answer of /api/recording (protocol.md). Errors: those of parse_recording(); kRefused
/// if the file has more than 2 GiB, or if the recording has X-ray but does not state the rate of
/// its ticks, from which the time of screening is computed.
Result<std::string> rows_of(const std::filesystem::path& recording);

}  // namespace trocar::runtime
