// SPDX-License-Identifier: Apache-2.0
// Loads the inputs of a session: scene, device description, sheets of the asset, and the recording
// that a replay needs.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "formats/base/result.h"
#include "formats/session/device_description.h"
#include "formats/session/recording.h"
#include "formats/session/scene.h"
#include "runtime/check/new_scene.h"
#include "runtime/check/scene_check.h"
#include "runtime/haptics/sheet.h"
#include "runtime/program/run_options.h"

namespace trocar::runtime {

struct SessionInputs {
  Scene scene;                    ///< the scene, with the changes that the command line makes
  DeviceDescription description;  ///< the four-legged device; not used if `pose_device` is set
  /// Description of the session's device if this device itself measures the pose of its plate.
  /// None: the session's device is the four-legged device, which measures joint angles.
  std::optional<PoseDeviceDescription> pose_device;
  /// The digest of the file from which `pose_device` was read, or "built-in/NAME" for a built-in
  /// description; empty: `pose_device` is none.
  std::string pose_device_origin;
  std::vector<std::unique_ptr<const Sheet>> sheets;
  std::vector<SliceTissue> tissues;  ///< tissue of each sheet
  std::vector<RecordingRow> replay;  ///< rows of the recording to replay; empty: no replay
  RecordingOrigin replay_origin;
  bool replay_is_cut = false;  ///< the last line of `replay` was incomplete, and is left out
  LoadedBytes bytes;

  AnyDeviceDescription device() const {
    return pose_device ? AnyDeviceDescription(*pose_device) : AnyDeviceDescription(description);
  }
};

/// How the program learns whether a device measures the orientation of its handle. kAsked: the
/// program connects to the device and asks. kAssumed: the program does not connect to the device,
/// and assumes that the device does not measure the orientation.
enum class HandleOrientation : std::uint8_t { kAsked, kAssumed };

/// Reads the description of the device from `file`. If `file` is empty, returns the built-in
/// description for `uri`, the value of --device. If there is no built-in description for `uri`,
/// returns the description of the four-legged device. Errors: kRefused if `file` is not acceptable;
/// with kAsked those of find_built_in_description() (open_device.h).
Result<AnyDeviceDescription> read_description(const std::filesystem::path& file,
                                              std::string_view uri, HandleOrientation orientation);

/// Gives a description without a delay that of a device outside this process: a tick.
void assume_delay(std::string_view uri, double rate_Hz, AnyDeviceDescription& description);

/// Loads the inputs that the arguments name. Errors: kRefused if an input is not acceptable; kUsage
/// if an option does not fit the device; those of find_built_in_description() (open_device.h).
Result<SessionInputs> load_inputs(const RunArguments& arguments);

}  // namespace trocar::runtime
