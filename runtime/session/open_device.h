// SPDX-License-Identifier: Apache-2.0
// The devices that a session can use, by URI. A new device is one file with a class derived from
// Device, and one entry in the table of open_device.cpp.
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <string_view>

#include "formats/base/result.h"
#include "formats/session/device_description.h"
#include "formats/session/scene.h"
#include "runtime/device/device.h"
#include "runtime/session/session.h"

namespace trocar::runtime {

inline constexpr std::string_view kDefaultDevice = "inproc";

struct OpenDeviceOptions {
  const Scene& scene;                    ///< its hand holds a simulated device
  std::string scene_name;                ///< for errors
  const DeviceDescription& description;  ///< of a simulated device
  std::filesystem::path key_file;        ///< of a device behind the link
  Clock clock = Clock::kReal;            ///< the session's
  double rate_Hz = 1000;                 ///< the session's
};

/// Usage errors: no device has this URI; a key file is missing, or given though none is needed.
Result<void> check_device_uri(std::string_view uri, bool has_key_file);

/// The device of a URI, ready for start(). Errors: those of check_device_uri, and the device's own.
Result<std::unique_ptr<Device>> open_device(std::string_view uri, const OpenDeviceOptions& options);

/// The help text of all URIs, such as "inproc: simulated in the process; udp:HOST:PORT: ...".
std::string device_uri_help();

}  // namespace trocar::runtime
