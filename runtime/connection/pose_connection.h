// SPDX-License-Identifier: Apache-2.0
// A connection to a device through a maker's SDK or service, whose calls may wait. ConnectedDevice
// (connected_device.h) calls the connection on a separate thread and makes a PoseDevice of it. An implementation
// may therefore allocate, lock and wait, and needs no thread.
// Tests: tests/runtime/connection/connected_device_test.cpp
#pragma once

#include <functional>
#include <string>

#include "formats/base/result.h"
#include "runtime/device/pose_device.h"

namespace trocar::runtime {

/// Longest time that exchange() may take. If the device is silent for longer, exchange() returns an error.
inline constexpr double kExchangeTimeout_s = 0.1;
/// Longest time that open() may take.
inline constexpr double kOpenTimeout_s = 5;

/// Receives one line for the operator, such as "haply:localhost:10001: a second device was found; the first
/// one is used".
using SayLine = std::function<void(const std::string& line)>;

/// One thread makes all calls: open(), then exchange() repeatedly, then close(), and possibly open() again.
class PoseConnection {
 public:
  virtual ~PoseConnection() = default;

  /// Connects, finds the device and leaves it with zero force. Errors: (kDeviceFault) one clear line that begins
  /// with the device's URI and says what the user can do. After an error only close() or open() may follow.
  virtual Result<void> open() = 0;
  /// Commands the wrench and returns the newest state of the device. Times of states ascend. What the device
  /// states is not trusted, so sizes, types and numbers are checked here. A single unusable message is not an
  /// error if the connection can continue. The next message is then awaited within kExchangeTimeout_s. Errors:
  /// (kDeviceFault) one clear line; close() must follow.
  virtual Result<PoseReading> exchange(const HandleWrench& wrench) = 0;
  /// Commands zero force if the connection still exists, and disconnects. Also allowed after an error.
  virtual void close() noexcept = 0;
};

}  // namespace trocar::runtime
