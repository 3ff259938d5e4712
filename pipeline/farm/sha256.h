// SPDX-License-Identifier: GPL-3.0-or-later
// SHA-256 of texts and files, by libsodium, as 64 lower-case hexadecimal digits.
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

/// Whether a text is 64 lower-case hexadecimal digits: what is read from a store becomes a path.
bool is_sha256(std::string_view text);

}  // namespace trocar::farm
