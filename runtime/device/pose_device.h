// SPDX-License-Identifier: Apache-2.0
// Interface to a device that measures the pose of its handle itself. A command to the device is a
// wrench on the handle. An implementation can be a desktop device with an SDK, a process behind the
// device link, a recording that is replayed, or a test. runtime/device/pose/pose_hand.h builds a
// HandDevice on this interface and adds all checks and limits, so a new device needs only one small
// class that implements PoseDevice.
//
// All values are in the device's own frame, in SI units. The device's description
// (formats/session/device_description.h) says how this frame is oriented, and which values are
// measured and rendered.
#pragma once

#include <array>
#include <cstdint>

#include "formats/base/result.h"
#include "formats/session/faults.h"
#include "formats/session/recording.h"
#include "runtime/device/device.h"

namespace trocar::runtime {

/// A measured pose. The struct is plain data, so that threads can pass it to each other.
struct PoseReading {
  double t_s = 0;                       ///< time of the measurement, on any clock that never jumps
  std::array<double, 3> p_m{};          ///< position of the point at which the wrench acts
  std::array<double, 4> q{1, 0, 0, 0};  ///< orientation, w x y z; ignored if it is not measured
  std::uint32_t buttons = 0;            ///< bit i: button i is pressed
};

/// Force in N and moment in N*m on the handle. The moment is about the point PoseReading::p_m.
using HandleWrench = std::array<double, 6>;

/// A session calls start() once, then read(), write() and advance() in each tick, and close() at
/// its end. The haptic thread calls read() and write(), so they never allocate, lock or block.
class PoseDevice : public DeviceConnection {
 public:
  /// Reads the latest pose. `reading` changes only if the result is kOk. The caller checks the
  /// numbers, so an implementation need not check them.
  virtual DeviceStatus read(PoseReading& reading) noexcept = 0;
  /// Sends the wrench that the device holds until the next write(). Never returns kEndOfData,
  /// because only read() reports the end of a replay.
  virtual DeviceStatus write(const HandleWrench& wrench) noexcept = 0;
  /// After a read() that returned kMotorFault, the byte with which the device reports its fault.
  /// The device's maker chooses the meaning of the byte; 0 means that the fault is not known.
  virtual std::uint8_t fault_byte() const noexcept { return 0; }
};

}  // namespace trocar::runtime
