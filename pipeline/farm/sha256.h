// SPDX-License-Identifier: GPL-3.0-or-later
// SHA-256 of texts and files as 64 lower-case hexadecimal digits, computed by libsodium.
// Tests: tests/pipeline/farm/store_test.cpp
#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <string_view>

#include "formats/base/result.h"

namespace trocar::farm {

std::string sha256_of(std::span<const std::uint8_t> bytes);
std::string sha256_of(std::string_view text);

/// Errors (refused) name the file.
Result<std::string> sha256_of_file(const std::filesystem::path& file);

/// Whether a text is 64 lower-case hexadecimal digits. Digests read from a store become paths, so
/// that they are checked first.
bool is_sha256(std::string_view text);

}  // namespace trocar::farm
