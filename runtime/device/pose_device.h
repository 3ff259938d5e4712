// SPDX-License-Identifier: Apache-2.0
// A device that measures the pose of its handle itself and is commanded a wrench on the handle: a desktop device with an
// SDK, a process behind the device link, a recording, or a test. runtime/pose_device/pose_hand.h builds a HandDevice on
// this interface and adds all checks and limits. A new device of this kind is therefore one small class.
//
// All values are in the device's own frame, in SI units. The device's description
// (formats/session/pose_device_description.h) says how this frame is oriented, and which values are
// measured and rendered.
// Tests: tests/runtime/pose_device/pose_hand_test.cpp
#pragma once

#include <array>
#include <cstdint>
#include <optional>

#include "formats/base/result.h"
#include "formats/session/device_status.h"
#include "runtime/device/link_report.h"

namespace trocar::runtime {

/// A pose that was measured at one time. The struct is plain data, so that threads can pass it to each other.
struct PoseReading {
  double t_s = 0;                       ///< time of the measurement, on any clock that never jumps
  std::array<double, 3> p_m{};          ///< position of the handle's point at which the wrench acts
  std::array<double, 4> q{1, 0, 0, 0};  ///< orientation, w x y z; ignored if it is not measured
  std::uint32_t buttons = 0;            ///< bit i: button i is pressed
};

/// Force in N and moment in N*m on the handle about PoseReading::p_m.
using HandleWrench = std::array<double, 6>;

/// A session calls start() once, then read(), write() and advance() in each tick, and close() at its end. The haptic
/// thread calls read(), write() and restore(), so these never allocate, lock, throw or block.
class PoseDevice {
 public:
  virtual ~PoseDevice() = default;

  /// Connects to the device. From then on the device may require a command in each period. May
  /// block. The caller calls it once.
  virtual Result<void> start() { return {}; }
  /// Reads the latest pose. `reading` changes only on kOk. The implementation need not check the numbers.
  virtual DeviceStatus read(PoseReading& reading) noexcept = 0;
  /// Sets the wrench to hold until the next write. Never returns kEndOfData.
  virtual DeviceStatus write(const HandleWrench& wrench) noexcept = 0;
  /// After a read() that returned kLinkLost or kMotorFault, requests a new connection. Returns immediately; read() returns
  /// kLinkLost until the connection is established.
  virtual void restore() noexcept {}
  /// Ends a tick of length `dt_s`. A device that is paced by the loop advances its time by `dt_s`.
  virtual void advance(double /*dt_s*/) {}
  /// Commands zero force and ends the connection to the device.
  virtual void close() {}

  /// True if the device's time advances only in advance(), so that a late tick does no harm.
  virtual bool is_paced_by_loop() const { return false; }
  /// Returns the counts of the link. Call this only after close(). A device without a
  /// link returns nullopt.
  virtual std::optional<LinkReport> link_report() const { return std::nullopt; }
};

}  // namespace trocar::runtime
