// SPDX-License-Identifier: Apache-2.0
// The devices that a session can use, and their URIs. A new device is one class derived from PoseConnection,
// PoseDevice or HandDevice, in a file of its own, and one entry in the table of open_device.cpp.
// Tests: tests/runtime/devices/open_device_test.cpp
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <string_view>

#include "formats/base/result.h"
#include "formats/session/pose_device_description.h"
#include "formats/session/scene.h"
#include "runtime/connection/pose_connection.h"
#include "runtime/device/device.h"
#include "runtime/device/hand_device.h"
#include "runtime/device/pose_device.h"
#include "runtime/session/session_options.h"
#include "runtime/simulation/hand.h"

namespace trocar::runtime {

inline constexpr std::string_view kDefaultDevice = "inproc";

struct OpenDeviceOptions {
  const Scene& scene;      ///< the hand of this scene holds a simulated device
  std::string scene_name;  ///< name of the scene in error messages
  const AnyDeviceDescription& description;
  std::filesystem::path key_file;  ///< key of the link to a device process
  bool is_simulated = false;       ///< the user says that a device process has no motors
  Clock clock = Clock::kReal;      ///< the session's clock
  double rate_Hz = 1000;           ///< the session's rate
  /// Moves the scene's hand. Null unless the scene's hand is live. It must outlive the device.
  UnscriptedHand* hand = nullptr;
  /// Receives messages about a device that is reached through a maker's SDK or service, one line
  /// each. It is never called on the haptic thread.
  SayLine say;
};

/// True if the device of this URI may have motors. The device that is simulated in this process has
/// none. Every other device is assumed to have motors, whatever the device reports.
bool may_have_motors(std::string_view uri);

/// Longest time without data from a simulated device process, in s. It is long because other work on the machine can
/// delay the process.
inline constexpr double kSimulatedNoData_s = 0.25;

/// True if the URI names a device process, which the device link (udp_link.h) reaches.
bool is_device_process(std::string_view uri);

/// Checks a URI. Errors: kUsage if no device has this URI, if a key file is needed but not given,
/// or if a key file is given but not needed.
Result<void> check_device_uri(std::string_view uri, bool has_key_file);

/// Returns the name of the built-in pose device description (pose_session.h) that belongs to a
/// URI. The name is empty if the URI has none: the device is the four-legged one, or the user must
/// give a description.
std::string_view built_in_description(std::string_view uri);
/// Like built_in_description(), but connects to the device to find out whether it measures
/// the orientation of its handle. If it does, the returned name ends with kWithRotation.
/// Blocks up to kOpenTimeout_s. Errors: kUsage if the address in the URI is wrong; those of
/// the device's PoseConnection::open().
Result<std::string> find_built_in_description(std::string_view uri);
/// A device ready for start(), or for the first tick of a replay.
struct OpenedDevice {
  std::unique_ptr<Device> encoders_and_motors;  ///< set for the four-legged device
  std::unique_ptr<PoseDevice> pose_device;      ///< set for a device that measures its own pose
  std::unique_ptr<HandDevice> device;           ///< uses one of the two members above
};

/// Builds the four-legged device from these encoders and motors.
OpenedDevice make_four_legs(const DeviceDescription& description,
                            std::unique_ptr<Device> encoders_and_motors);

/// Builds the hand device from this pose device. pose_frame() determines where the device lies
/// in the scene.
OpenedDevice make_pose_hand(const PoseDeviceDescription& description, const Scene& scene,
                            std::unique_ptr<PoseDevice> pose_device);

/// Makes the simulated device of this description, held by the scene's hand. Errors: kRefused if
/// the device cannot reach the position where the hand begins; kBug if the scene's hand is live.
Result<std::shared_ptr<HandDevice>> simulate_device(const Scene& scene,
                                                    const AnyDeviceDescription& description);

/// Makes the specification of a device of this description, placed in the scene.
std::unique_ptr<DeviceSpecification> make_specification(const AnyDeviceDescription& description,
                                                        const Scene& scene);

/// Opens the device of a URI. Errors: those of check_device_uri() and of the device; kUsage if the
/// description is for another kind of device. For the device that is simulated in this process:
/// kBug if the scene's hand is live and OpenDeviceOptions::hand is null, or the scene's hand is not
/// live and OpenDeviceOptions::hand is set.
Result<OpenedDevice> open_device(std::string_view uri, const OpenDeviceOptions& options);

/// Returns the help text of all URIs, such as "inproc: simulated in the process; udp:HOST:PORT:
/// ...".
std::string device_uri_help();

}  // namespace trocar::runtime
