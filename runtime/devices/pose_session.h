// SPDX-License-Identifier: Apache-2.0
// A session with a pose device: the descriptions of known devices, the position of the device in the scene, the limits that
// follow from both, and the entries about the device in a recording.
// Tests: tests/runtime/devices/pose_session_test.cpp
#pragma once

#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "formats/base/result.h"
#include "formats/session/pose_device_description.h"
#include "formats/session/recording.h"
#include "formats/session/scene.h"
#include "runtime/contact/sheet.h"
#include "runtime/device/pose_device.h"
#include "runtime/session/session_options.h"
#include "runtime/simulation/hand.h"

namespace trocar::runtime {

/// Suffix of the name of a built-in description whose device measures the orientation of its handle.
inline constexpr std::string_view kWithRotation = "+rotation";

/// Returns the built-in description with this name, such as "haply_inverse3" (runtime/device/NAME.json), possibly with
/// kWithRotation. Errors: (refused) there is none.
Result<PoseDeviceDescription> built_in_pose_device(std::string_view name);

/// Sets the limits that belong to a pose device: the box of its workspace, zero force in the tick that finds a fault, and a force
/// that rises from zero when a session begins. If the force law is one of separate sheets, a virtual coupling keeps the rendered
/// stiffness within StiffnessLimits and the stiffness that the device states.
void set_pose_device_options(const PoseDeviceDescription& description, const Scene& scene,
                             SessionOptions& options);

/// Returns the largest force scale, at most the scene's, with which the device can render the forces at which the scene's tissues
/// break. For a bone volume this includes a margin for friction on the shaft. Errors: those of the law's factory.
Result<double> fitting_force_scale(const PoseDeviceDescription& description, const Scene& scene,
                                   std::span<const std::unique_ptr<const Sheet>> sheets,
                                   double rate_Hz);

/// Writes the device into the origin of a recording. `device`: the digest of its description, or "built-in/NAME".
void state_pose_device(const std::string& device, const PoseDeviceDescription& description,
                       const Scene& scene, const SessionOptions& options, RecordingOrigin& origin);

/// Entries of an origin about a pose device.
struct StatedPoseDevice {
  std::optional<std::string> built_in;  ///< the built-in description's name
  double force_scale = 1, force_max_N = 0, stiffness_margin = 1;
};
/// Returns none if the recording was not made with a pose device.
std::optional<StatedPoseDevice> stated_pose_device(const RecordingOrigin& recorded);

/// A pose device that returns the readings and statuses of a recording, tick by tick.
class ReplayPoseDevice final : public PoseDevice {
 public:
  /// `rows` must outlive the device.
  explicit ReplayPoseDevice(std::span<const RecordingRow> rows) : rows_(rows) {}

  /// Returns the reading and status of the next row; kEndOfData after the last row.
  DeviceStatus read(PoseReading& reading) noexcept override;
  DeviceStatus write(const HandleWrench& /*wrench*/) noexcept override {
    return next_ == 0 ? DeviceStatus::kOk : rows_[next_ - 1].device_write;
  }

 private:
  std::span<const RecordingRow> rows_;
  std::size_t next_ = 0;
};

}  // namespace trocar::runtime
