// SPDX-License-Identifier: Apache-2.0
// A drive behind the device link as a Device of the loop. On the haptic thread only non-blocking
// receive and send calls: no allocation, lock or exception. What is not authentic, or old, is
// counted and otherwise as if it had not come.
//
// A session that is lost is made anew when restore() asks for it: real clock, by a thread that has
// the socket to itself meanwhile; lock-step, where time stands still, by wait_for_answer().
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <optional>
#include <thread>

#include "formats/session/device_protocol.h"
#include "formats/base/result.h"
#include "runtime/device/device.h"
#include "runtime/link/udp_socket.h"

namespace trocar::runtime {

struct UdpDeviceOptions {
  Endpoint peer;
  LinkKey key;
  double period_s = 1e-3;              ///< of the loop; a drive in lock-step goes by it
  LinkClock clock = LinkClock::kReal;  ///< the drive must have the same
  bool fresh = true;                   ///< a simulated world begins anew
  double connect_timeout_s = 5;
  double silence_s = 0.01;  ///< without a state: the link is lost (real clock)
  double answer_s = 2;      ///< lock-step: longest wait for an answer; once one has not come,
                            ///< silence_s until the next one comes
};

class UdpDevice final : public Device {
 public:
  /// Hello, welcome, and a first state. Blocks at most connect_timeout_s. Errors: device fault, if
  /// there is no answer; usage, if the drive goes by another clock.
  static Result<std::unique_ptr<UdpDevice>> connect(const UdpDeviceOptions& options);
  /// close().
  ~UdpDevice() override;
  /// Says that the session is over, and ends what restore() began. Of use afterwards: the counts.
  void close();
  UdpDevice(const UdpDevice&) = delete;
  UdpDevice& operator=(const UdpDevice&) = delete;

  /// The newest state that has come since the last call. kNoData: none has, and not for long, or so
  /// many wait (after a loop's slow start) that the newest of all may have found no room;
  /// kLinkLost: none for silence_s, the other end is closed, or the drive has not heard our torques
  /// of the last silence_s (2.5 periods if that is longer), or its watchdog has acted;
  /// kEmergencyStop, kMotorFault: what it says.
  DeviceStatus read(DeviceState& state) noexcept override;
  /// kLinkLost: nobody listens; kNoData: not sent (a torque that is none, no room).
  DeviceStatus write(const DeviceCommand& command) noexcept override;

  /// Lock-step: waits for the answer to the last write, for at most answer_s; the read() after it
  /// has it, or kLinkLost. Blocks.
  bool wait_for_answer() noexcept;

  /// A new session with the same drive, or one that was started at its place, joining the
  /// simulated world as it is: tried until it is there (lock-step: for connect_timeout_s, then
  /// never again; what answers but cannot be had, such as a drive that goes by another clock, is
  /// asked again after a pause). Torques are zero; read() and write() say kLinkLost meanwhile.
  /// Acts only if the last read() has found the link lost or a motor's fault, which a drive keeps
  /// for a session.
  void restore() noexcept override;

  // While nothing is being restored, or after close().
  /// Why the last attempt to restore the session failed; none: it did not, or there was none.
  const std::optional<Error>& restore_error() const noexcept { return restore_error_; }
  const LinkCounts& packets() const noexcept { return counts_; }
  /// States that were sent in this device's sessions and never accepted: lost, or overtaken. From
  /// the first torques on: before them a loop may take its time.
  std::uint64_t states_missed() const noexcept { return states_missed_; }
  std::uint64_t sessions() const noexcept { return sessions_; }
  double drive_period_s() const noexcept { return drive_period_s_; }

 private:
  UdpDevice(const UdpDeviceOptions& options, UdpSocket socket)
      : options_(options), socket_(std::move(socket)) {}
  Result<void> shake_hands(bool fresh);
  /// As part of restore(): the same, its error kept.
  bool shake_hands_again();
  void restore_when_asked();
  DeviceStatus status_of_newest() const noexcept;
  /// Takes what is there, at most kMostDatagrams. False: the other end is closed.
  bool drain() noexcept;
  UdpSocket::Outcome send(CommandMode mode, const DeviceCommand& command) noexcept;

  /// More than these wait for the next tick, so that no flood can hold one up.
  static constexpr int kMostDatagrams = 512;
  /// Of states: a socket's own buffer holds some 270.
  static constexpr int kLongQueue = 128;

  UdpDeviceOptions options_;
  UdpSocket socket_;
  LinkKey session_key_;
  std::uint64_t session_ = 0, last_command_ = 0, last_state_ = 0;
  double drive_period_s_ = 0;
  StatePacket newest_;
  bool fresh_state_ = false;
  int queued_ = 0;              ///< states that the last drain() took
  std::int64_t newest_ns_ = 0;  ///< when newest_ came
  bool has_written_ = false;    ///< torques, in this session
  LinkCounts counts_;
  std::uint64_t states_missed_ = 0, sessions_ = 0;
  bool counts_missed_ = false;
  bool answers_come_ = true;  ///< lock-step
  bool is_away_ = false;      ///< the last read() has found it so
  bool given_up_ = false;     ///< lock-step: no drive came back
  std::optional<Error> restore_error_;
  /// All else is the restoring thread's while it is set, and the haptic thread's while it is not.
  std::atomic<bool> restoring_{false};
  std::atomic<bool> closing_{false};
  static_assert(std::atomic<bool>::is_always_lock_free);
  std::thread restorer_;  ///< real clock
};

}  // namespace trocar::runtime
