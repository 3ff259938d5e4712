// SPDX-License-Identifier: Apache-2.0
// Reads and writes the file with the key that host and drive of the device link share. With the
// key, each end checks that packets come from the other end. The file contains 64 hexadecimal
// digits and a line feed. Only the file's owner may have access to the file (mode 0600 or 0400).
#pragma once

#include <filesystem>

#include "formats/base/result.h"
#include "formats/session/device_protocol.h"

namespace trocar::runtime {

/// Reads the key. Errors: kRefused if the file cannot be read, is not a regular file, is owned by
/// another user, or does not contain 64 hexadecimal digits, or if other users have access to it.
Result<LinkKey> read_link_key(const std::filesystem::path& file);

/// Writes a new random key to a new file of mode 0600, and returns the key. Errors: kUnwritable if
/// the file exists or cannot be written.
Result<LinkKey> make_link_key(const std::filesystem::path& file);

}  // namespace trocar::runtime
