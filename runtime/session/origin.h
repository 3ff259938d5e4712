// SPDX-License-Identifier: Apache-2.0
// Makes, reads and compares the origin of a recording. The origin states the inputs and options of
// the session that made the recording (formats/session/recording.h).
#pragma once

#include <filesystem>
#include <string>

#include "formats/base/result.h"
#include "formats/session/device_description.h"
#include "formats/session/recording.h"
#include "formats/session/scene.h"
#include "runtime/session/session_options.h"

namespace trocar::runtime {

/// Returns BLAKE2b-256 of the file's bytes in hexadecimal, as `b2sum -l 256` prints it. Errors:
/// kRefused if the file cannot be read.
Result<std::string> digest_of(const std::filesystem::path& file);

/// Makes the origin of a session's recording. `scene_file`: the file from which `scene` was read.
/// `scene` and `description` include the changes made by the command line. Options that affect
/// torques get an entry in the origin, and so does the duration if it is not the scene's. Some
/// options have no entry if they have their default value. Errors: those of digest_of() for the
/// files of scene, asset and device description.
Result<RecordingOrigin> make_origin(const std::filesystem::path& scene_file, const Scene& scene,
                                    const DeviceDescription& description,
                                    const SessionOptions& options);

// A replay uses limits, rate and duration of the recorded session. The next three functions give
// them.

/// Sets the limits that the recorded session had:
///  - StiffnessLimits::margin: kHardwareMargin if the recording states this margin, otherwise 1.
///  - SafetyLimits::gap_max_s and state_gap_max_s: if late ticks were no fault in the recorded
///    session, 0 and infinite: the rows then state whether the device's clock has leapt. Otherwise
///    unchanged. In sessions with a device that another process simulates, late ticks are no fault
///    by default.
///  - SafetyLimits::no_data_max_s: the stated time. If the recording does not state this time, the
///    default. Also the default if the stated time is below the default or above 1 s, because
///    trocar-run records no such time: the recording is then damaged or was edited.
void set_stated_limits(const RecordingOrigin& recorded, SessionOptions& options);

/// Returns the rate of the haptic loop that the recording states, or 0 if it states none.
double stated_rate_Hz(const RecordingOrigin& recorded);

/// Returns the duration that the recorded session was to have: the duration that the recording
/// states, otherwise the scene's duration. A recording states a duration only if the option
/// --duration has replaced the scene's duration.
double stated_duration_s(const RecordingOrigin& recorded, const Scene& scene);

/// Checks that a replay has the inputs of its recording. `run`: the origin of the session that is
/// to replay the recording; `name`: the recording's name, for messages. Returns a warning if the
/// recording was made by another version of the program, otherwise an empty string. Errors:
/// kRefused if the recording has no origin, or if the scene, the asset, the device description or an
/// option differs.
Result<std::string> check_replay(const RecordingOrigin& recorded, const RecordingOrigin& run,
                                 const std::string& name);

}  // namespace trocar::runtime
