// SPDX-License-Identifier: Apache-2.0
// Files by which the console follows its sessions. Each session has a folder, a log, and a symbolic
// link to the shared memory of the session.
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <filesystem>
#include <string>

#include "formats/base/result.h"

namespace trocar::runtime {

/// Creates a folder such as SESSIONS/20261130T053438Z-NAME. The folder's name consists of the time
/// (utc_name()) and the name of the scene's file, in which '_' replaces all characters except
/// letters, digits, '_' and '-'. If the folder exists, the new folder's name gets the suffix "-2",
/// "-3" and so on. Only the owner may read the folder, because its files name trainees; this also
/// holds for `sessions`, if it is made here. Errors: kRefused if `sessions` is a link; kUnwritable if the
/// folder cannot be created.
Result<std::filesystem::path> create_session_folder(const std::filesystem::path& sessions,
                                                    const std::filesystem::path& scene);

/// Searches the log of a device process, from byte `from` on, for the line "ready on HOST:PORT".
/// Returns HOST:PORT, or an empty text if the process is not ready yet.
std::string ready_endpoint(const std::filesystem::path& log, std::uint64_t from);

/// Returns the last line with text in the last 64 KiB of a log, shortened to 400 bytes.
std::string last_line(const std::filesystem::path& log);

/// Returns a text that says why a session ended. Use it if the session's programs printed no
/// reason. The function derives the reason from the exit code and from the free space on the disk
/// of `folder`, the session's folder.
std::string reason_of(ExitCode code, const std::filesystem::path& folder);

/// Returns the last 64 KiB of a log, or an empty text if there is no such file.
std::string tail_of(const std::filesystem::path& log);

/// The link to a session's shared memory points to /proc/PID/fd/N. Returns PID, the number of the
/// session's process, or 0 if `link` does not point into /proc.
pid_t pid_of_link(const std::filesystem::path& link);

}  // namespace trocar::runtime
