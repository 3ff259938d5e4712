// SPDX-License-Identifier: Apache-2.0
// The device link's shared key in a file: 64 hexadecimal digits and a line feed, for its owner
// alone (mode 0600 or 0400).
#pragma once

#include <filesystem>

#include "formats/session/device_protocol.h"
#include "formats/base/result.h"

namespace trocar::runtime {

/// Refused: no regular file, readable or writable by others, somebody else's, not 64 digits.
Result<LinkKey> read_link_key(const std::filesystem::path& file);

/// A new random key in a new file of mode 0600. Unwritable also if the file is there already.
Result<LinkKey> make_link_key(const std::filesystem::path& file);

}  // namespace trocar::runtime
