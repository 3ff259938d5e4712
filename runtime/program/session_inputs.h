// SPDX-License-Identifier: Apache-2.0
// Loads the inputs of a session: scene, device description, sheets of the asset, and a
// recording to replay.
// Tests: tests/e2e/told_e2e_test.py
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "formats/base/result.h"
#include "formats/session/pose_device_description.h"
#include "formats/session/recording.h"
#include "formats/session/scene.h"
#include "runtime/checking/scene_requirements.h"
#include "runtime/checking/tissue_assignment.h"
#include "runtime/contact/sheet.h"
#include "runtime/program/run_arguments.h"

namespace trocar::runtime {

struct SessionInputs {
  Scene scene;                    ///< the scene with the changes made by the command line
  DeviceDescription description;  ///< description of the four-legged device
  std::optional<PoseDeviceDescription>
      pose_device;                 ///< the session's device, if it measures its own pose
  std::string pose_device_origin;  ///< digest of its description, or "built-in/NAME"
  std::vector<std::unique_ptr<const Sheet>> sheets;
  std::vector<SliceTissue> tissues;  ///< tissue of each sheet
  std::vector<RecordingRow> replay;
  RecordingOrigin replay_origin;
  LoadedBytes bytes;

  AnyDeviceDescription device() const {
    return pose_device ? AnyDeviceDescription(*pose_device) : AnyDeviceDescription(description);
  }
};

/// Reads the description of the device. If `file` is empty, returns the built-in description for `uri`, by default that of the
/// four-legged device.
Result<AnyDeviceDescription> read_description(const std::filesystem::path& file,
                                              std::string_view uri);

Result<SessionInputs> load_inputs(const RunArguments& arguments);

}  // namespace trocar::runtime
