// SPDX-License-Identifier: Apache-2.0
// The devices that a session can use, and their URIs. A new device is one class derived from
// HandDevice, in a file of its own, and one entry in the table of open_device.cpp.
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <string_view>

#include "formats/base/result.h"
#include "formats/session/device_description.h"
#include "formats/session/scene.h"
#include "runtime/device/device.h"
#include "runtime/device/hand_device.h"
#include "runtime/session/session_options.h"
#include "runtime/simulation/hand.h"

namespace trocar::runtime {

inline constexpr std::string_view kDefaultDevice = "inproc";

struct OpenDeviceOptions {
  const Scene& scene;      ///< the scene's hand holds a simulated device
  std::string scene_name;  ///< name of the scene in error messages
  const DeviceDescription& description;
  std::filesystem::path key_file;  ///< key of the link to a device process
  bool is_simulated = false;       ///< a device process is known to have no motors
  Clock clock = Clock::kReal;      ///< the session's clock
  double rate_Hz = 1000;           ///< the session's rate
  UnscriptedHand* hand =
      nullptr;  ///< moves the scene's hand, if that is live; must outlive the device
};

/// True if the device may have motors. Only the device in the process is known to be simulated; a device process is
/// taken to have motors, whatever it says.
bool may_have_motors(std::string_view uri);

/// Checks a URI. Errors: (usage) no device has this URI; a key file is missing; a key file is given
/// but not needed.
Result<void> check_device_uri(std::string_view uri, bool has_key_file);

/// A device ready for start(), or for the first tick of a replay.
struct OpenedDevice {
  std::unique_ptr<Device> encoders_and_motors;
  std::unique_ptr<HandDevice> device;  ///< uses the encoders and motors
};

/// Makes the four-legged device of these encoders and motors.
OpenedDevice make_four_legs(const DeviceDescription& description,
                            std::unique_ptr<Device> encoders_and_motors);

/// Opens the device of a URI. Errors: those of check_device_uri() and
/// of the device; (bug) the scene's hand is live, and there is no OpenDeviceOptions::hand, or the reverse.
Result<OpenedDevice> open_device(std::string_view uri, const OpenDeviceOptions& options);

/// Returns the help text of all URIs, such as "inproc: simulated in the process; udp:HOST:PORT:
/// ...".
std::string device_uri_help();

}  // namespace trocar::runtime
