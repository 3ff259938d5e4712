// SPDX-License-Identifier: Apache-2.0
// Encodes a recording for playback.
// Tests: tests/e2e/console_server_test.py
#pragma once

#include <filesystem>
#include <string>

#include "formats/base/result.h"

namespace trocar::runtime {

/// Returns the answer of /api/recording (protocol.md). Errors: (refused) what trocar-run --replay
/// refuses, and files of more than 2 GiB.
Result<std::string> rows_of(const std::filesystem::path& recording);

}  // namespace trocar::runtime
