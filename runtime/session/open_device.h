// SPDX-License-Identifier: Apache-2.0
// Opens the devices of a session: by URI, simulated, or from a recording.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "formats/base/result.h"
#include "formats/session/device_description.h"
#include "formats/session/recording.h"
#include "formats/session/scene.h"
#include "runtime/device/device.h"
#include "runtime/device/hand_device.h"
#include "runtime/device/pose/connected_device.h"
#include "runtime/device/pose_device.h"
#include "runtime/device/simulated/hand.h"
#include "runtime/device/simulated/mechanics.h"
#include "runtime/device/simulated/simulated_device.h"
#include "runtime/session/session_options.h"

namespace trocar::runtime {

// Plays back a recording: each read() returns the device's state and status from the next row of
// the recording. ReplayDevice does this for the four-legged device, ReplayPoseDevice for a device
// that measures its own pose.

/// Sets the device's state of a row, which the device had sent or measured in the row's tick.
inline void take_state(const RecordingRow& row, DeviceState& state) noexcept {
  state = {row.state_t_s, row.encoder_rad};
}
inline void take_state(const RecordingRow& row, PoseReading& reading) noexcept {
  reading = {row.state_t_s, row.pose_device.p_m, row.pose_device.q, row.pose_device.buttons};
}

/// `Interface` is Device or PoseDevice. `State` and `Command` are what its read() and write() take.
template <typename Interface, typename State, typename Command>
class RecordedDevice final : public Interface {
 public:
  /// `rows` must outlive the device.
  explicit RecordedDevice(std::span<const RecordingRow> rows) : rows_(rows) {}

  /// Returns the state and the status of the next row, or kEndOfData after the last row.
  DeviceStatus read(State& state) noexcept override {
    if (next_ == rows_.size()) return DeviceStatus::kEndOfData;
    const RecordingRow& row = rows_[next_++];
    if (row.device_read == DeviceStatus::kOk) take_state(row, state);
    return row.device_read;
  }
  DeviceStatus write(const Command&) noexcept override {
    return next_ == 0 ? DeviceStatus::kOk : rows_[next_ - 1].device_write;
  }

 private:
  std::span<const RecordingRow> rows_;
  std::size_t next_ = 0;
};
using ReplayDevice = RecordedDevice<Device, DeviceState, DeviceCommand>;
using ReplayPoseDevice = RecordedDevice<PoseDevice, PoseReading, HandleWrench>;

// Converts the hand that a scene describes to the simulated hand of runtime/device/simulated/hand.h.

/// Returns the keyframes of the scene's hand as the path of a target. The simulated hand pulls the
/// tool's tip to this target.
HandTrajectory hand_trajectory(const Scene& scene);

/// Returns the impedance of the scene's hand (stiffness, damping and mass). A value that the scene
/// does not state is taken from the hand's grip.
HandImpedance hand_impedance(const SceneHand& hand);

// Makes simulated devices. A scene describes a simulated hand (SceneHand), which holds and moves
// such a device.

/// Makes a simulated four-legged device, which the scene's hand holds, beginning at its first
/// keyframe. If `hand` is not null, the targets of the hand come from `hand` instead of the scene's
/// keyframes, and `hand` must outlive the device. If `mechanics` is nullopt, the device is the light
/// model of simulated_device.h, in which only the plate has mass. Errors: those of
/// SimulatedDevice::make().
Result<SimulatedDevice> make_simulated_device(
    const Scene& scene, const DeviceDescription& description, UnscriptedHand* hand = nullptr,
    const std::optional<MechanicsOptions>& mechanics = std::nullopt);

/// Returns the frame that places a pose device in a scene. The keyframes of the scene's hand give
/// positions of the plate (of a pose device, the plate is its handle). The frame is chosen so that
/// the middle of the box around these positions coincides with the middle of the device's
/// workspace.
PoseFrame pose_frame(const PoseDeviceDescription& description, const Scene& scene);

/// Makes a simulated pose device, which the scene's hand holds. If `hand` is not null, the targets
/// of the hand come from `hand` instead of the scene's keyframes, and `hand` must outlive the
/// device. Errors: those of SimulatedPoseDevice::make().
Result<SimulatedPoseDevice> make_simulated_pose_device(const Scene& scene,
                                                       const PoseDeviceDescription& description,
                                                       UnscriptedHand* hand);

// Opens the devices that a session can use. A URI names a device. To add a device, follow
// ARCHITECTURE.md, "A device".

inline constexpr std::string_view kDefaultDevice = "inproc";

struct OpenDeviceOptions {
  const Scene& scene;      ///< the scene, whose hand holds a device simulated in this process
  std::string scene_name;  ///< name of the scene in error messages
  const AnyDeviceDescription& description;
  std::filesystem::path key_file;  ///< key for a device process (is_device_process()); empty: none
  bool is_simulated = false;       ///< the user states that the device process has no motors
  Clock clock = Clock::kReal;      ///< the session's clock
  double rate_Hz = 1000;           ///< the session's rate
  /// The live hand that holds a simulated device; must outlive the device. Null if the
  /// scene's hand is not live.
  UnscriptedHand* hand = nullptr;
  /// Receives messages about a device that is reached through a maker's SDK or service. If an
  /// attempt to restore a lost link to a device process fails, also receives the reason. Each call
  /// gives one line, and with the real clock no call is on the haptic thread.
  SayLine say;
};

/// True if the device of this URI may have motors. Only the device that is simulated in this
/// process surely has none. The function does not ask the device.
bool may_have_motors(std::string_view uri);

/// Longest allowed gap in the data from a device process that has no motors. It is longer than for
/// a device with motors, because other work on the machine can delay the process.
inline constexpr double kSimulatedNoData_s = 0.25;

/// True if the URI names a device process, to which the session connects by the
/// device link (udp_link.h).
bool is_device_process(std::string_view uri);

/// Checks a URI. Errors: kUsage if no device has this URI, if a key file is needed but not given,
/// or if a key file is given but not needed.
Result<void> check_device_uri(std::string_view uri, bool has_key_file);

/// Returns the name of the built-in pose device description (pose_session.h) that belongs to a URI.
/// Returns an empty name if no built-in description belongs to the URI. The device is then the
/// four-legged one, or the user must give a description.
std::string_view built_in_description(std::string_view uri);
/// Like built_in_description(), but connects to the device and asks whether the device measures the
/// orientation of its handle. If so, the returned name ends with kWithRotation. Blocks up to
/// kOpenTimeout_s. Errors: kUsage if the address in the URI is wrong, and the errors of
/// PoseConnection::open().
Result<std::string> find_built_in_description(std::string_view uri);
/// A device whose HandDevice::start() has not been called yet. A replayed recording needs no
/// start() before its first tick.
struct OpenedDevice {
  std::unique_ptr<Device> encoders_and_motors;  ///< set for the four-legged device
  std::unique_ptr<PoseDevice> pose_device;      ///< set for a device that measures its own pose
  std::unique_ptr<HandDevice> device;  ///< the device for the loop; uses one of the members above
};

/// Builds the four-legged hand device on these encoders and motors.
OpenedDevice make_four_legs(const DeviceDescription& description,
                            std::unique_ptr<Device> encoders_and_motors);

/// Builds the hand device on this pose device. pose_frame() determines where the
/// device lies in the scene.
OpenedDevice make_pose_hand(const PoseDeviceDescription& description, const Scene& scene,
                            std::unique_ptr<PoseDevice> pose_device);

/// Makes the simulated device of this description, held by the scene's hand. Errors: kBug if the
/// scene's hand is live; those of make_simulated_device() or make_simulated_pose_device().
Result<std::shared_ptr<HandDevice>> simulate_device(const Scene& scene,
                                                    const AnyDeviceDescription& description);

/// Makes the specification of a device with this description. The scene determines where a pose
/// device lies (pose_frame()).
std::unique_ptr<DeviceSpecification> make_specification(const AnyDeviceDescription& description,
                                                        const Scene& scene);

/// Opens the device of a URI. Errors: those of check_device_uri() and of the device; kUsage if the
/// description and the URI are for different kinds of device; kUsage if the device has its own
/// clock and the session's clock is not Clock::kReal. For the device that is simulated in this
/// process, OpenDeviceOptions::hand must be set if the scene's hand is live, and null if the
/// scene's hand is not live. If this does not hold, the error is kBug.
Result<OpenedDevice> open_device(std::string_view uri, const OpenDeviceOptions& options);

/// Returns the URIs of all devices with an explanation of each, as text for `--help`.
std::string device_uri_help();

}  // namespace trocar::runtime
