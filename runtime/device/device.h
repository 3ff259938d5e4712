// SPDX-License-Identifier: Apache-2.0
// Interface to the encoders and motors of the four-legged device: angles come in, torques go out.
// An implementation can be a simulated device in this process, the link to a drive (the motor
// electronics), a recording that is replayed, or a test. runtime/mechanism/four_legs.h builds a
// HandDevice on this interface.
#pragma once

#include <array>
#include <cstdint>
#include <optional>

#include "formats/base/result.h"
#include "formats/session/device_status.h"
#include "formats/session/fault_words.h"
#include "runtime/device/link_report.h"

namespace trocar::runtime {

inline constexpr int kLegs = 4;
inline constexpr int kMotors = 2 * kLegs;    ///< order: leg by leg, joints 1 and 4 of each leg
inline constexpr int kEncoders = 4 * kLegs;  ///< order: leg by leg, joints 1 to 4 of each leg

struct DeviceState {
  /// Time at which the encoders were read, on the device's clock. It ascends from state to state.
  double t_s = 0;
  std::array<double, kEncoders> encoder_rad{};
};

struct DeviceCommand {
  std::array<double, kMotors> tau_motor_Nm{};
};

/// A session calls start() once, then read(), write() and advance() in each tick, and close() at
/// its end. The haptic thread calls read(), write() and restore(), so these three functions never
/// allocate, lock, throw or block.
class Device {
 public:
  virtual ~Device() = default;

  /// Connects to the device. May block. After a successful start() the caller must send a command
  /// in each period of the loop, because the device may have a watchdog. Precondition: start() was
  /// not called before.
  virtual Result<void> start() { return {}; }
  /// Reads the latest state. `state` changes only if the result is kOk.
  virtual DeviceStatus read(DeviceState& state) = 0;
  /// Sends the torques that the motors hold until the next write(). Never returns kEndOfData,
  /// because only read() reports the end of a replay.
  virtual DeviceStatus write(const DeviceCommand& command) = 0;
  /// After a read() that returned kMotorFault, bit i is set if motor i does not apply its torque.
  /// The value 0 means that the faulty motors are not known.
  virtual std::uint8_t fault_byte() const noexcept { return 0; }
  /// After a read() that returned kNoData or kLinkLost: if states do arrive, but are refused
  /// because of their contents, the fault kRefusedState with the field of the newest one.
  /// Otherwise no fault.
  virtual FaultDetail refused_contents() const noexcept { return {}; }
  /// After a read() that returned kLinkLost or kMotorFault, requests a new connection. Returns
  /// immediately; read() returns kLinkLost until the connection is established.
  virtual void restore() {}
  /// Ends a tick of length `dt_s`. If is_paced_by_loop() is true, the device advances its time by
  /// `dt_s`, and the call may block. Called on the thread of read() and write().
  virtual void advance(double /*dt_s*/) {}
  /// Ends the connection to the device.
  virtual void close() {}

  /// True if the device's time advances only in advance(). Such a device waits for a late tick.
  virtual bool is_paced_by_loop() const { return false; }
  /// Returns the counts of the link, or nullopt if there is no link. Call this only after close().
  virtual std::optional<LinkReport> link_report() const { return std::nullopt; }
};

}  // namespace trocar::runtime
