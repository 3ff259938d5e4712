// SPDX-License-Identifier: GPL-3.0-or-later
// Atomic files: a file of a store appears complete or not at all. Its bytes are written to a
// temporary file in the store's tmp/, synced, read back and checked. Then the temporary file
// is renamed to its final path, and the folder there is synced. The file appears at the moment
// of the rename, also over NFS. After each step there is a failpoint, at which a test can kill
// the process (failpoint.h).
#pragma once

#include <sys/stat.h>
#include <sys/types.h>

#include <cstdint>
#include <filesystem>
#include <functional>
#include <span>
#include <string>
#include <string_view>

#include "formats/base/result.h"

namespace trocar::farm {

/// A path in `folder` for a temporary file, which no other process uses. Its name begins with this
/// process's ProcessIdentity::text().
std::filesystem::path temporary_name(const std::filesystem::path& folder);

/// Gives a new file or folder to the users of the store in which it is made. `like` is a folder of the
/// store. The right owner and group are those of `like`; only root can give away the owner. If `like`
/// is shared by a group (is_shared()), the group gets the same rights as the owner, whatever the
/// umask. `mode` is reduced by the umask first. Returns false and sets errno if the mode cannot be
/// set. That the owner or group cannot be set is no error: Store::open_for_writing() refuses users
/// whose files would get others.
bool give_to_users(int fd, const std::filesystem::path& like, mode_t mode);

/// Is the folder shared by its group: may the group write in it, and do new files get its group (bit
/// setgid)?
bool is_shared(const struct stat& folder);

/// Makes a folder like `like` (give_to_users()). If it exists, it is left as it is. Errors:
/// kUnwritable.
Result<void> make_folder(const std::filesystem::path& folder, const std::filesystem::path& like);

struct AtomicFile {
  std::filesystem::path target;
  std::filesystem::path tmp;  ///< folder of temporary files, in the same file system as the target
  mode_t mode = 0666;         ///< permissions of the file (give_to_users())
  bool is_synced = true;      ///< false if the file may be lost in a power failure
  /// An optional check of the bytes that were read back, in addition to the comparison with the
  /// written bytes. An error of `prove` prevents the rename.
  std::function<Result<void>(std::span<const std::uint8_t>)> prove = {};
};

/// Writes or replaces the target. If the target's folder is missing, creates it, but not the
/// folder's parents. Errors: kUnwritable if the target cannot be written (the message names the
/// path); those of `prove`. After an error the temporary file is removed, and the target is
/// unchanged unless the error is that of the last step: if the folder cannot be synced, the target
/// has the new bytes.
Result<void> write_atomically(const AtomicFile& file, std::span<const std::uint8_t> bytes);
Result<void> write_atomically(const AtomicFile& file, const std::string& text);

/// Makes `link` a symbolic link to `target` by a rename, which replaces an older link. The link is
/// not synced. Errors: kUnwritable; the message names the link.
Result<void> link_atomically(const std::filesystem::path& target, const std::filesystem::path& link,
                             const std::filesystem::path& tmp);

/// Writes all bytes to a descriptor. Returns false and sets errno if they cannot be written.
bool write_all(int fd, std::span<const std::uint8_t> bytes);
bool write_all(int fd, std::string_view text);

/// Syncs a folder's entries to the disk. Errors: kUnwritable; the message names the folder.
Result<void> sync_folder(const std::filesystem::path& folder);

/// The error "FILE: cannot be written: REASON" for an errno.
Error cannot_write(const std::filesystem::path& file, int error);

}  // namespace trocar::farm
