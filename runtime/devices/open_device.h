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
  const Scene& scene;      ///< the scene's hand holds a simulated device
  std::string scene_name;  ///< name of the scene in error messages
  const AnyDeviceDescription& description;
  std::filesystem::path key_file;  ///< key of the link to a device process
  bool is_simulated = false;       ///< a device process or a service is known to have no motors
  Clock clock = Clock::kReal;      ///< the session's clock
  double rate_Hz = 1000;           ///< the session's rate
  UnscriptedHand* hand =
      nullptr;  ///< moves the scene's hand, if that is live; must outlive the device
  SayLine
      say;  ///< takes what a device of another maker has to say, one line each; not on the haptic thread
};

/// True if the device may have motors. Only the device in the process is known to be simulated. A device process is assumed to
/// have motors, whatever it reports.
bool may_have_motors(std::string_view uri);

/// Longest time without data from a simulated device process, in s. It is long because other work on the machine can
/// delay the process.
inline constexpr double kSimulatedNoData_s = 0.25;

/// True if the device is a process behind the device link.
bool is_device_process(std::string_view uri);

/// Checks a URI. Errors: (usage) no device has this URI; a key file is missing; a key file is given
/// but not needed.
Result<void> check_device_uri(std::string_view uri, bool has_key_file);

/// Returns the name of the built-in description of a pose device (pose_session.h) that belongs to a URI. Empty: the URI is that of
/// the four-legged device, or the user must give a description.
std::string_view built_in_description(std::string_view uri);
/// Like built_in_description(), but asks the device, so that the description states whether the orientation of the handle is
/// measured. Blocks up to kOpenTimeout_s. Errors: those of the device's PoseConnection::open().
Result<std::string> find_built_in_description(std::string_view uri);
/// A device ready for start(), or for the first tick of a replay.
struct OpenedDevice {
  std::unique_ptr<Device> encoders_and_motors;  ///< set for the four-legged device
  std::unique_ptr<PoseDevice> pose_device;      ///< set for a device that measures its own pose
  std::unique_ptr<HandDevice> device;           ///< uses one of these two
};

/// Builds the four-legged device from these encoders and motors.
OpenedDevice make_four_legs(const DeviceDescription& description,
                            std::unique_ptr<Device> encoders_and_motors);

/// Builds the hand device from this pose device, placed in the scene as pose_frame() returns.
OpenedDevice make_pose_hand(const PoseDeviceDescription& description, const Scene& scene,
                            std::unique_ptr<PoseDevice> pose_device);

/// Makes the simulated device of this description, held by the scene's hand, which must not be live. Errors: (refused) the device
/// cannot be at the position where the hand begins.
Result<std::shared_ptr<HandDevice>> simulate_device(const Scene& scene,
                                                    const AnyDeviceDescription& description);

/// Makes the specification of a device of this description, placed in the scene.
std::unique_ptr<DeviceSpecification> make_specification(const AnyDeviceDescription& description,
                                                        const Scene& scene);

/// Opens the device of a URI. Errors: those of check_device_uri() and of the device; (usage) the description is for another kind
/// of device; (bug) the scene's hand is live but OpenDeviceOptions::hand is null, or the hand is not live but
/// OpenDeviceOptions::hand is set.
Result<OpenedDevice> open_device(std::string_view uri, const OpenDeviceOptions& options);

/// Returns the help text of all URIs, such as "inproc: simulated in the process; udp:HOST:PORT:
/// ...".
std::string device_uri_help();

}  // namespace trocar::runtime
