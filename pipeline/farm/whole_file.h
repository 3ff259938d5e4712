// SPDX-License-Identifier: GPL-3.0-or-later
// Files of a store are written whole or not at all: a temporary file in the store's tmp/, synced,
// read back and proven, renamed; then its folder is synced. A rename is what commits, also over
// NFS. Each step is a fault point (fault_point.h).
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <filesystem>
#include <functional>
#include <span>
#include <string>

#include "formats/base/result.h"

namespace trocar::farm {

/// A path for a temporary file that no other process has, in `folder`; its name begins with
/// this process's Owner::text().
std::filesystem::path temporary_name(const std::filesystem::path& folder);

struct WholeFile {
  std::filesystem::path target;
  std::filesystem::path tmp;  ///< the folder of temporary files, in the same file system
  mode_t mode = 0666;         ///< without the process's umask
  bool is_synced = true;      ///< false: a loss of power may take it; then it can be made again
  /// What is to hold of the bytes that were read back; they are known to be those that were given.
  std::function<Result<void>(std::span<const std::uint8_t>)> prove = {};
};

/// Replaces the target. Makes its folder, if that is missing in an existing one. Errors
/// (unwritable) name the target and leave it as it was, without a temporary file.
Result<void> write_whole(const WholeFile& file, std::span<const std::uint8_t> bytes);
Result<void> write_whole(const WholeFile& file, const std::string& text);

/// A symbolic link, replaced in the same way. A link that is as wanted is left alone.
Result<void> link_whole(const std::filesystem::path& target, const std::filesystem::path& link,
                        const std::filesystem::path& tmp);

/// Errors (unwritable) name the folder.
Result<void> sync_folder(const std::filesystem::path& folder);

/// "FILE: cannot be written: REASON" of an errno.
Error cannot_write(const std::filesystem::path& file, int error);

}  // namespace trocar::farm
