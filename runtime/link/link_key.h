// SPDX-License-Identifier: Apache-2.0
// The device link's shared key in a file: 64 hexadecimal digits and a line feed. Only its owner may
// have access (mode 0600 or 0400).
#pragma once

#include <filesystem>

#include "formats/base/result.h"
#include "formats/session/device_protocol.h"

namespace trocar::runtime {

/// Refused: not a regular file, owned by another user, readable or writable by others, or not 64
/// digits.
Result<LinkKey> read_link_key(const std::filesystem::path& file);

/// A new random key in a new file of mode 0600. Errors: unwritable, also if the file exists.
Result<LinkKey> make_link_key(const std::filesystem::path& file);

}  // namespace trocar::runtime
