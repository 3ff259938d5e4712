// SPDX-License-Identifier: Apache-2.0
// A session with a pose device: the descriptions of known devices, where the device lies in the scene, the limits that
// follow, and how its recording states it.
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

/// Ends the name of a built-in description whose device measures the orientation of its handle.
inline constexpr std::string_view kWithRotation = "+rotation";

/// Returns the built-in description with this name, such as "haply_inverse3" (runtime/device/NAME.json), possibly with
/// kWithRotation. Errors: (refused) there is none.
Result<PoseDeviceDescription> built_in_pose_device(std::string_view name);

/// Sets the limits that belong to a pose device: the box of its workspace, zero force in the tick that finds a fault, and
/// a force that rises from zero when a session begins. With a law whose sheets are touched directly, a virtual coupling keeps the
/// rendered stiffness within StiffnessLimits and what the device states.
void set_pose_device_options(const PoseDeviceDescription& description, const Scene& scene,
                             SessionOptions& options);

/// Returns the largest force scale, at most the scene's, with which the device renders the forces at which the scene's tissue
/// breaks, in a bone volume with a margin for friction on the shaft. Errors: those of the law's factory.
Result<double> fitting_force_scale(const PoseDeviceDescription& description, const Scene& scene,
                                   std::span<const std::unique_ptr<const Sheet>> sheets,
                                   double rate_Hz);

/// States the device in the origin of a recording: `device` is the digest of its description, or "built-in/NAME".
void state_pose_device(const std::string& device, const PoseDeviceDescription& description,
                       const Scene& scene, const SessionOptions& options, RecordingOrigin& origin);

/// Entries of an origin about a pose device.
struct StatedPoseDevice {
  std::optional<std::string> built_in;  ///< the built-in description's name
  double force_scale = 1, force_max_N = 0, stiffness_margin = 1;
};
/// Returns none if the recording is not one of a pose device.
std::optional<StatedPoseDevice> stated_pose_device(const RecordingOrigin& recorded);

/// The readings and statuses of a recording, tick by tick, as a pose device.
class ReplayPoseDevice final : public PoseDevice {
 public:
  /// `rows` must outlive the device.
  explicit ReplayPoseDevice(std::span<const RecordingRow> rows) : rows_(rows) {}

  /// Returns reading and status of the next row; kEndOfData after the last row.
  DeviceStatus read(PoseReading& reading) noexcept override;
  DeviceStatus write(const HandleWrench& /*wrench*/) noexcept override {
    return next_ == 0 ? DeviceStatus::kOk : rows_[next_ - 1].device_write;
  }

 private:
  std::span<const RecordingRow> rows_;
  std::size_t next_ = 0;
};

}  // namespace trocar::runtime
