// SPDX-License-Identifier: Apache-2.0
// Makes the origin of a recording (formats/session/recording_origin.h).
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "formats/base/result.h"
#include "formats/session/device_description.h"
#include "formats/session/recording_origin.h"
#include "formats/session/scene.h"
#include "runtime/session/session_options.h"

namespace trocar::runtime {

/// BLAKE2b-256 of the file's bytes in hexadecimal, as printed by `b2sum -l 256` and as in
/// trocar-mesh's report. Refused: the file cannot be read.
Result<std::string> digest_of(const std::filesystem::path& file);

/// `scene_file`: the file of `scene`. `scene` and `description` include the changes of the command
/// line. Every option on which torques depend gets an entry.
Result<RecordingOrigin> make_origin(const std::filesystem::path& scene_file, const Scene& scene,
                                    const DeviceDescription& description,
                                    const SessionOptions& options);

/// The rate of the haptic loop that a recording states; 0: none.
double stated_rate_Hz(const RecordingOrigin& recorded);

/// Compares the recording `name` with the run that is to replay it. Refused: scene, asset, device
/// description or an option differs. Otherwise returns a warning if the recording has no origin or
/// comes from another version of the program, or an empty string.
Result<std::string> check_replay(const RecordingOrigin& recorded, const RecordingOrigin& run,
                                 const std::string& name);

}  // namespace trocar::runtime
