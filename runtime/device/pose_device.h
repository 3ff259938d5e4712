// SPDX-License-Identifier: Apache-2.0
// A device that measures the pose of its handle itself and is commanded a wrench on the handle: a desktop device with
// an SDK, a process behind the device link, a recording, or a test. runtime/pose_device/pose_hand.h makes a
// HandDevice of it, with all checks and limits, so that a new device of this kind is one small class.
//
// Everything is in the device's own frame, in SI units. Its description
// (formats/session/pose_device_description.h) says how this frame is turned, and which values are measured and rendered.
// Tests: tests/runtime/pose_device/pose_hand_test.cpp
#pragma once

#include <array>
#include <cstdint>
#include <optional>

#include "formats/base/result.h"
#include "formats/session/device_status.h"
#include "runtime/device/link_report.h"

namespace trocar::runtime {

/// A pose that was measured at one time. It is plain data, so that threads can hand it over.
struct PoseReading {
  double t_s = 0;                       ///< time of the measurement, on any clock that never jumps
  std::array<double, 3> p_m{};          ///< the point of the handle on which the wrench acts
  std::array<double, 4> q{1, 0, 0, 0};  ///< orientation, w x y z; ignored if it is not measured
  std::uint32_t buttons = 0;            ///< bit i: button i is pressed
};

/// Force in N and moment in N*m on the handle about PoseReading::p_m.
using HandleWrench = std::array<double, 6>;

/// A session calls start() once, then read(), write() and advance() in each tick, and close() at its end. The haptic
/// thread calls read(), write() and restore(): they never allocate, lock, throw or block.
class PoseDevice {
 public:
  virtual ~PoseDevice() = default;

  /// Begins a session with the device. From then on the device may expect ticks. May block. Called once.
  virtual Result<void> start() { return {}; }
  /// Reads the latest pose. `reading` changes only on kOk. The numbers need not be checked.
  virtual DeviceStatus read(PoseReading& reading) noexcept = 0;
  /// Sets the wrench to hold until the next write. Never returns kEndOfData.
  virtual DeviceStatus write(const HandleWrench& wrench) noexcept = 0;
  /// After a read() that returned kLinkLost or kMotorFault, requests a new connection. Returns immediately; read() returns
  /// kLinkLost until the connection is established.
  virtual void restore() noexcept {}
  /// Ends a tick of `dt_s`, and advances the time of a device that is paced by the loop.
  virtual void advance(double /*dt_s*/) {}
  /// Ends the session without force.
  virtual void close() {}

  /// True if the device's time advances only in advance(), so that a late tick does no harm.
  virtual bool is_paced_by_loop() const { return false; }
  /// Returns the counts of the link, after close(); none for a device without a link.
  virtual std::optional<LinkReport> link_report() const { return std::nullopt; }
};

}  // namespace trocar::runtime
