// SPDX-License-Identifier: Apache-2.0
// A connection to a device through a maker's SDK or service, whose calls may wait. ConnectedDevice
// (connected_device.h) calls it on a thread of its own and makes a PoseDevice of it, so an implementation may
// allocate, lock and wait, and needs no thread.
// Tests: tests/runtime/connection/connected_device_test.cpp
#pragma once

#include <functional>
#include <string>

#include "formats/base/result.h"
#include "runtime/device/pose_device.h"

namespace trocar::runtime {

/// Longest time that exchange() may take. After a longer silence it returns an error.
inline constexpr double kExchangeTimeout_s = 0.1;
/// Longest time that open() may take.
inline constexpr double kOpenTimeout_s = 5;

/// Takes one line for the operator, such as "haply:localhost:10001: a second device was found; the first one is used".
using SayLine = std::function<void(const std::string& line)>;

/// One thread calls open(), then exchange() again and again, and close(); after close() possibly open() again.
class PoseConnection {
 public:
  virtual ~PoseConnection() = default;

  /// Connects, finds the device and leaves it without force. Errors: (kDeviceFault) one clear line that begins with
  /// the device's URI and says what the user can do. After an error only close() or open() follows.
  virtual Result<void> open() = 0;
  /// Commands the wrench and returns the newest state of the device, whose time ascends. What the device stated is
  /// hostile: sizes, types and numbers are checked here. A single unusable message is
  /// no error if the connection can go on: then the next message is awaited within kExchangeTimeout_s.
  /// Errors: (kDeviceFault) one clear line; close() follows.
  virtual Result<PoseReading> exchange(const HandleWrench& wrench) = 0;
  /// Commands no force if the connection still stands, and disconnects. Also allowed after an error.
  virtual void close() noexcept = 0;
};

}  // namespace trocar::runtime
