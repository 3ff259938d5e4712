// SPDX-License-Identifier: Apache-2.0
// Reads two texts about a session: the description that the session publishes in its shared memory,
// and the console's note about the session's device. Also writes the note. Both texts may be
// damaged. If a value is missing or has the wrong type, the value counts as empty.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "formats/base/result.h"

namespace trocar::runtime {

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

}  // namespace trocar::runtime
