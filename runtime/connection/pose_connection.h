// SPDX-License-Identifier: Apache-2.0
// A connection to a device through a maker's SDK or service, whose calls may block. ConnectedDevice
// (connected_device.h) turns a connection into a PoseDevice: it makes the exchanges on a separate
// thread. An implementation of PoseConnection may therefore allocate, lock and block, and needs no
// thread of its own.
#pragma once

#include <functional>
#include <string>

#include "formats/base/result.h"
#include "runtime/device/pose_device.h"

namespace trocar::runtime {

/// Longest time that exchange() may take. If the device is silent for longer, exchange() returns an
/// error.
inline constexpr double kExchangeTimeout_s = 0.1;
/// Longest time that open() may take.
inline constexpr double kOpenTimeout_s = 5;

/// Receives one line for the operator, such as "haply:localhost:10001: a second device was found;
/// the first one is used".
using SayLine = std::function<void(const std::string& line)>;

/// The caller calls open(), then exchange() repeatedly, then close(), and possibly open() again.
/// Different threads may make these calls, but never two at the same time.
class PoseConnection {
 public:
  virtual ~PoseConnection() = default;

  /// Connects, finds the device and commands zero force. After a first success, every later call
  /// must find the same device again. Errors: kDeviceFault. The message is one clear line that
  /// begins with the device's URI and says what the user can do. After an error the caller may call
  /// only close() or open().
  virtual Result<void> open() = 0;
  /// Commands the wrench and returns the newest reading of the device. The times of readings do not
  /// descend; a reading with the time of the one before is the same measurement, given again. The
  /// implementation does not trust data from the device: it checks sizes, types and numbers. An
  /// unusable message from the device need not be an error: the implementation may wait for the
  /// next message, as long as exchange() ends within kExchangeTimeout_s. Errors: kDeviceFault, with
  /// a message of one clear line. After an error the caller must call close().
  virtual Result<PoseReading> exchange(const HandleWrench& wrench) = 0;
  /// After an exchange() that returned an error: kRefusedState with the field, if a message of the
  /// device was refused because of its contents. Otherwise no fault.
  virtual FaultDetail refused_contents() const noexcept { return {}; }
  /// Commands zero force if the connection still exists, and disconnects. Also allowed after an
  /// error.
  virtual void close() noexcept = 0;
};

}  // namespace trocar::runtime
