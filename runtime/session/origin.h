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
#include "runtime/session/session.h"

namespace trocar::runtime {

/// BLAKE2b-256 of the file's bytes, hexadecimal: what `b2sum -l 256` prints, and an asset's digest
/// in trocar-mesh's report. Refused: it cannot be read.
Result<std::string> digest_of(const std::filesystem::path& file);

/// `scene_file`: where `scene` was read. `scene` and `description` as the session uses them, with
/// the command line's options; an option that torques depend on gets its entry here.
Result<RecordingOrigin> make_origin(const std::filesystem::path& scene_file, const Scene& scene,
                                    const DeviceDescription& description,
                                    const SessionOptions& options);

/// The loop rate that a recording's origin states; 0: none.
double stated_rate_Hz(const RecordingOrigin& recorded);

/// Compares a recording `name` with the run that is to replay it. Refused: another scene, asset,
/// device description or option. Else a warning, or an empty string: the recording has no origin,
/// or is of another version of the program.
Result<std::string> check_replay(const RecordingOrigin& recorded, const RecordingOrigin& run,
                                 const std::string& name);

}  // namespace trocar::runtime
