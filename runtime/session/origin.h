// SPDX-License-Identifier: Apache-2.0
// Makes the origin of a recording: the inputs and options of its session
// (formats/session/recording_origin.h).
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

/// Returns BLAKE2b-256 of the file's bytes in hexadecimal, like `b2sum -l 256` and trocar-mesh's
/// report. Errors: kRefused if the file cannot be read.
Result<std::string> digest_of(const std::filesystem::path& file);

/// Makes the origin. `scene_file`: the file from which `scene` was read. `scene` and `description`
/// include the changes made by the command line. Every option that affects torques gets an entry.
/// Errors: those of digest_of() for the files of scene, asset and device description.
Result<RecordingOrigin> make_origin(const std::filesystem::path& scene_file, const Scene& scene,
                                    const DeviceDescription& description,
                                    const SessionOptions& options);

/// Returns the StiffnessLimits::margin of a recording; 1 if the recording states none.
double stated_stiffness_margin(const RecordingOrigin& recorded);

/// Returns true if a recording states that the time between two readings of the device was not
/// limited (SafetyLimits::gap_max_s was 0), as with a simulated device process.
bool allows_any_state_gap(const RecordingOrigin& recorded);

/// Returns the SafetyLimits::no_data_max_s that a recording states. Returns the default of this
/// limit if the recording states none, or one that is below the default or above 1 s.
double stated_no_data_limit_s(const RecordingOrigin& recorded);

/// Returns the rate of the haptic loop that a recording states; 0: the recording states none.
double stated_rate_Hz(const RecordingOrigin& recorded);

/// Compares the origin of the recording `name` with the origin `run` of the session that is to
/// replay this recording. Returns a warning if the recording has no origin or was made by another
/// version of the program, and an empty string otherwise. Errors: kRefused if the scene, the asset,
/// the device description or an option differs.
Result<std::string> check_replay(const RecordingOrigin& recorded, const RecordingOrigin& run,
                                 const std::string& name);

}  // namespace trocar::runtime
