// SPDX-License-Identifier: GPL-3.0-or-later
// Digests that identify an input without revealing its contents.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "formats/base/result.h"

namespace trocar::pipeline {

/// BLAKE2b-256 of a file's bytes, hexadecimal. Errors: kRefused if the file cannot be read.
Result<std::string> digest_file(const std::filesystem::path& file);

inline constexpr std::size_t kMinKeyBytes = 16, kMaxKeyBytes = 64;

/// The keyed digest of an input, hexadecimal: BLAKE2b-256 of the concatenated results of
/// digest_file() for its files. Only a holder of the key can compute it and so recognise the input.
/// Precondition: the key has kMinKeyBytes to kMaxKeyBytes bytes.
std::string digest_input(const std::vector<std::string>& file_digests,
                         const std::vector<std::uint8_t>& key);

}  // namespace trocar::pipeline
