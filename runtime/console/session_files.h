// SPDX-License-Identifier: Apache-2.0
// The files of the console's sessions, and the texts about a session.
#pragma once

#include <sys/types.h>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "formats/base/result.h"

namespace trocar::runtime {

// Reads two texts about a session: the description that the session publishes in its shared memory,
// and the console's note about the session's device. Also writes the note. Both texts may be
// damaged. If a value is missing or has the wrong type, the value counts as empty.

/// The description in a session's shared memory (formats/session/telemetry.md).
struct SessionAbout {
  std::string json;                  ///< whole description; "{}" if the text is no JSON object
  std::string id;                    ///< identifies the session: process number and start time
  std::string scene, asset, record;  ///< names of files as given to the session
  std::string clock, device;
  bool has_live_hand = false, takes_xray = false;
  /// The columns of a snapshot (named groups of its values), as JSON: the description's `columns`
  /// before the first column that has no valid size or does not fit into a snapshot.
  std::string columns;
  /// Name of each column in `columns`, and index of its first value in a snapshot.
  std::vector<std::pair<std::string, std::size_t>> column_at;
  std::vector<std::int32_t> slices;  ///< slice index of each sheet; -1: not known
};
/// Parses a description. `snapshot_values`: number of values in a snapshot of this session.
SessionAbout parse_about(std::string_view text, std::size_t snapshot_values);

/// The device process of a session, as the file console.json in the session's folder describes it.
/// If the console is started again, it finds the process by this note.
struct DeviceNote {
  std::int64_t pid = 0;
  std::uint64_t start_ticks = 0;  ///< Process::start_ticks()
  std::string endpoint;           ///< HOST:PORT at which the process listens
};
/// Writes the file console.json. `device`: the name of the session's device. `process`: nullopt if
/// the console started no device process. Errors: those of write_file_atomically().
Result<void> write_device_note(const std::filesystem::path& file, const std::string& device,
                               const std::optional<DeviceNote>& process);
/// Returns the name of the session's device from the file console.json, or an empty text if the
/// file does not contain the name.
std::string noted_device(const std::filesystem::path& file);
/// Returns the device process from the file console.json, or nullopt if the file names none.
std::optional<DeviceNote> read_device_note(const std::filesystem::path& file);

// Files by which the console follows its sessions. Each session has a folder, a log, and a symbolic
// link to the shared memory of the session.

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
