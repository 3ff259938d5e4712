// SPDX-License-Identifier: Apache-2.0
// Whole files in and out. Outputs appear whole or not at all.
#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <string_view>
#include <vector>

#include "formats/result.h"

namespace trocar {

/// The file's bytes; refused if it cannot be read or is larger than `max_bytes`.
Result<std::vector<std::uint8_t>> read_file(const std::filesystem::path& file,
                                            std::uint64_t max_bytes = std::uint64_t{1} << 32);

/// Could `file` be written, as far as one can tell beforehand? Better known before the work than
/// after it. An empty path counts as no output wanted.
Result<void> check_writable(const std::filesystem::path& file);

/// Writes beside the target, syncs, renames over it. On failure (unwritable) the target
/// is as it was and nothing is left behind.
Result<void> write_file_atomically(const std::filesystem::path& file,
                                   std::span<const std::uint8_t> bytes);
Result<void> write_file_atomically(const std::filesystem::path& file, std::string_view text);

}  // namespace trocar
