// SPDX-License-Identifier: Apache-2.0
// A drive behind the device link as a Device of the loop. On the haptic thread only non-blocking
// receive and send calls: no allocation, lock or exception. What is not authentic, or old, is
// counted and otherwise as if it had not come.
#pragma once

#include <cstdint>
#include <memory>

#include "formats/device_protocol.h"
#include "formats/result.h"
#include "runtime/device/device.h"
#include "runtime/device/udp_socket.h"

namespace trocar::runtime {

struct UdpDeviceOptions {
  Endpoint peer;
  LinkKey key;
  double period_s = 1e-3;              ///< of the loop; a drive in lock-step goes by it
  LinkClock clock = LinkClock::kReal;  ///< the drive must have the same
  bool fresh = true;                   ///< a simulated world begins anew
  double connect_timeout_s = 5;
  double silence_s = 0.01;  ///< without a state: the link is lost (real clock)
  double answer_s = 2;      ///< lock-step: longest wait for an answer
};

class UdpDevice final : public Device {
 public:
  /// Hello, welcome, and a first state. Blocks at most connect_timeout_s. Errors: device fault, if
  /// there is no answer; usage, if the drive goes by another clock.
  static Result<std::unique_ptr<UdpDevice>> connect(const UdpDeviceOptions& options);
  /// Says that the session is over.
  ~UdpDevice() override;
  UdpDevice(const UdpDevice&) = delete;
  UdpDevice& operator=(const UdpDevice&) = delete;

  /// The newest state that has come since the last call. kNoData: none has, and not for long;
  /// kLinkLost: none for silence_s, the other end is closed, or the drive has not heard our torques
  /// of the last silence_s (2.5 periods if that is longer), or its watchdog has acted;
  /// kEmergencyStop, kMotorFault: what it says.
  DeviceStatus read(DeviceState& state) noexcept override;
  /// kLinkLost: nobody listens; kNoData: not sent (a torque that is none, no room).
  DeviceStatus write(const DeviceCommand& command) noexcept override;

  /// Lock-step: waits for the answer to the last write, for at most answer_s; the read() after it
  /// has it, or kLinkLost. Blocks.
  bool wait_for_answer() noexcept;

  /// A new session with the same drive after a fault, joining the simulated world as it is.
  /// Torques are zero. Blocks like connect().
  Result<void> reconnect();

  const LinkCounts& packets() const noexcept { return counts_; }
  double drive_period_s() const noexcept { return drive_period_s_; }

 private:
  UdpDevice(const UdpDeviceOptions& options, UdpSocket socket)
      : options_(options), socket_(std::move(socket)) {}
  Result<void> shake_hands(bool fresh);
  /// Takes what is there, at most kMostDatagrams. False: the other end is closed.
  bool drain() noexcept;
  UdpSocket::Outcome send(CommandMode mode, const DeviceCommand& command) noexcept;

  /// More than these wait for the next tick, so that no flood can hold one up.
  static constexpr int kMostDatagrams = 512;

  UdpDeviceOptions options_;
  UdpSocket socket_;
  LinkKey session_key_;
  std::uint64_t session_ = 0, last_command_ = 0, last_state_ = 0;
  double drive_period_s_ = 0;
  StatePacket newest_;
  bool fresh_state_ = false;
  std::int64_t newest_ns_ = 0;  ///< when newest_ came
  bool has_written_ = false;    ///< torques, in this session
  LinkCounts counts_;
};

}  // namespace trocar::runtime
