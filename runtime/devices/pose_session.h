// SPDX-License-Identifier: Apache-2.0
// What a session with a pose device needs: the built-in descriptions of devices, the limits and the
// force scale that fit a device and a scene, the entries about the device in a recording, and a
// device that replays a recording.
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

/// Suffix of a built-in description's name, if the device measures the orientation of its handle.
inline constexpr std::string_view kWithRotation = "+rotation";

/// Returns the built-in description with this name, such as "haply_inverse3"
/// (runtime/device/NAME.json). If the name ends with kWithRotation, the description's
/// senses_rotation is true, otherwise false. Errors: kRefused if there is no such description.
Result<PoseDeviceDescription> built_in_pose_device(std::string_view name);

/// Sets the options that depend on the pose device. The box of the device's workspace becomes the
/// workspace limit. The force is zero in the tick that finds a fault, without a ramp. When a
/// session begins, the force rises from zero. The rendered stiffness is limited to StiffnessLimits
/// and to the largest stiffness that the description gives. If the force law treats slices as
/// separate sheets, a virtual coupling is switched on to keep that limit.
void set_pose_device_options(const PoseDeviceDescription& description, const Scene& scene,
                             SessionOptions& options);

/// Returns the largest force scale (factor on all forces of a scene), at most the scene's own, with
/// which the device can render the forces at which the scene's tissues break. With the force law
/// `cutting` this includes a margin for friction on the shaft. Errors: those of the law's factory.
Result<double> fitting_force_scale(const PoseDeviceDescription& description, const Scene& scene,
                                   std::span<const std::unique_ptr<const Sheet>> sheets,
                                   double rate_Hz);

/// Writes the entries about the device into the origin of a recording. `device`: the digest of its
/// description, or "built-in/NAME".
void write_pose_device_origin(const std::string& device, const PoseDeviceDescription& description,
                              const Scene& scene, const SessionOptions& options,
                              RecordingOrigin& origin);

/// Entries about a pose device in a recording's origin.
struct PoseDeviceOrigin {
  std::optional<std::string> built_in;  ///< none: the description is not built in
  double force_scale = 1, force_max_N = 0, stiffness_margin = 1;
};
/// Reads these entries. Returns nullopt if the recording was not made with a pose device.
std::optional<PoseDeviceOrigin> read_pose_device_origin(const RecordingOrigin& recorded);

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
