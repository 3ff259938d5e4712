// SPDX-License-Identifier: GPL-3.0-or-later
// SHA-256 of texts and files as 64 lower-case hexadecimal digits, computed by libsodium. Also the
// bytes of a text, and the hexadecimal digits of any bytes.
#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <string_view>

#include "formats/base/result.h"

namespace trocar::farm {

/// The bytes of a text.
std::span<const std::uint8_t> text_bytes(std::string_view text);
/// The bytes as lower-case hexadecimal digits.
std::string hex_of(std::span<const std::uint8_t> bytes);

std::string sha256_of(std::span<const std::uint8_t> bytes);
std::string sha256_of(std::string_view text);

/// Errors: kRefused if the file cannot be read; the message names the file.
Result<std::string> sha256_of_file(const std::filesystem::path& file);

/// Does the text consist of 64 lower-case hexadecimal digits? The caller must check a digest that
/// was read from a store before the digest becomes part of a path.
bool is_sha256(std::string_view text);

}  // namespace trocar::farm
