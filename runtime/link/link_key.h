// SPDX-License-Identifier: Apache-2.0
// The file of the device link's shared key. It contains 64 hexadecimal digits and a line feed. Only
// its owner may have access (mode 0600 or 0400).
#pragma once

#include <filesystem>

#include "formats/base/result.h"
#include "formats/session/device_protocol.h"

namespace trocar::runtime {

/// Reads the key. Errors: (refused) the file is not a regular file, is owned by another user, is
/// readable or writable by others, or does not contain 64 digits.
Result<LinkKey> read_link_key(const std::filesystem::path& file);

/// Writes a new random key to a new file of mode 0600. Errors: (unwritable) the file exists, or
/// cannot be written.
Result<LinkKey> make_link_key(const std::filesystem::path& file);

}  // namespace trocar::runtime
