// SPDX-License-Identifier: Apache-2.0
// The host's end of the device link (formats/session/device_link.md), for both kinds of drives: UdpDevice
// (udp_device.h) and UdpPoseDevice (udp_pose_device.h). On the haptic thread it only makes non-blocking receive and
// send calls: no allocation, lock or exception. Packets that are old or not authentic are counted and otherwise
// ignored.
//
// After a session is lost, restore() requests a new one. With the real clock a separate thread
// establishes the session, and is meanwhile the only user of the socket. In lock-step the drive's
// time does not advance, so advance() establishes the session.
// Tests: tests/runtime/link/udp_device_test.cpp, tests/runtime/link/udp_pose_device_test.cpp
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <memory>
#include <optional>
#include <thread>
#include <utility>

#include "formats/base/result.h"
#include "formats/session/device_protocol.h"
#include "runtime/device/device.h"
#include "runtime/device/pose_device.h"
#include "runtime/link/udp_socket.h"

namespace trocar::runtime {

struct UdpDeviceOptions {
  Endpoint peer;
  LinkKey key;
  double period_s = 1e-3;              ///< period of the loop; in lock-step also the drive's step
  LinkClock clock = LinkClock::kReal;  ///< must be the same as the drive's
  bool fresh = true;                   ///< start() resets the simulated world
  double connect_timeout_s = 5;
  double no_state_s = 0.01;  ///< real clock: the link is lost after this time without a state
  /// Lock-step: longest wait for an answer. After a missed answer, the longest wait is no_state_s
  /// until the next answer arrives.
  double answer_s = 2;
};

/// A drive that states the angles of the four-legged device and takes torques.
struct AngleDrive {
  static constexpr LinkContents kContents = LinkContents::kAngles;
  using Interface = Device;
  using Reading = DeviceState;
  using Output = DeviceCommand;
  using Command = CommandPacket;
  using State = StatePacket;
  static std::uint8_t faults(const State& state) noexcept { return state.motor_faults; }
  static void unpack(const State& state, Reading& reading) noexcept;
  static void pack(const Output& torques, Command& command) noexcept;
};

/// A drive that states the pose of a handle and takes a wrench.
struct PoseDrive {
  static constexpr LinkContents kContents = LinkContents::kPose;
  using Interface = PoseDevice;
  using Reading = PoseReading;
  using Output = HandleWrench;
  using Command = WrenchCommandPacket;
  using State = PoseStatePacket;
  static std::uint8_t faults(const State& state) noexcept { return state.faults; }
  static void unpack(const State& state, Reading& reading) noexcept;
  static void pack(const Output& wrench, Command& command) noexcept;
};

/// Kind: AngleDrive or PoseDrive. In the following, torques also stand for the wrench.
template <typename Kind>
class UdpLink : public Kind::Interface {
 public:
  using Reading = typename Kind::Reading;
  using Output = typename Kind::Output;

  /// Calls close().
  ~UdpLink() override;
  UdpLink(const UdpLink&) = delete;
  UdpLink& operator=(const UdpLink&) = delete;

  /// Establishes a session: hello, welcome and a first state. Blocks for at most connect_timeout_s.
  /// Errors: device fault (no answer, another key, another host, another program, or a drive of the other kind);
  /// usage (the drive has another clock).
  Result<void> start() override;
  /// Ends the session at the drive, and any restore() in progress. The counts can still be read.
  void close() override;

  /// Reads the newest state since the last call.
  ///  - kNoData: there is no new state, but for less than no_state_s; or, after a slow start of the
  ///    loop, so many states are queued that the socket may have dropped the newest.
  ///  - kLinkLost: there has been no state for no_state_s; the other end is closed; the drive has
  ///    received none of the torques of the last no_state_s (or of the last 2.5 periods if that is
  ///    longer); or the drive's watchdog tripped.
  ///  - kEmergencyStop, kMotorFault: the drive reports it.
  DeviceStatus read(Reading& reading) noexcept override;
  /// Sends torques. kLinkLost: the other end is closed. kNoData: the torques were not sent, because
  /// one is not finite or too large, or because the socket's buffer is full.
  DeviceStatus write(const Output& torques) noexcept override;
  /// In lock-step, calls wait_for_answer().
  void advance(double /*dt_s*/) noexcept override {
    if (options_.clock == LinkClock::kLockStep) wait_for_answer();
  }
  bool is_paced_by_loop() const noexcept override { return options_.clock == LinkClock::kLockStep; }

  /// Lock-step: waits at most answer_s for the answer to the last write(). Returns false if there
  /// is no answer. The next read() returns the answer, or kLinkLost. Blocks.
  bool wait_for_answer() noexcept;

  /// Requests a new session with the same drive, or with a drive that was started in its place. The
  /// session continues the simulated world in its present state. With the real clock, attempts are
  /// repeated until one succeeds, with a pause after each; in lock-step, attempts end after
  /// connect_timeout_s. Until there is a session, torques are zero, and read() and write() return
  /// kLinkLost. The request has an effect only if the last read() returned kLinkLost, or
  /// kMotorFault (which a drive reports until its session ends).
  void restore() noexcept override;

  // The following functions may be called only while no restore() is in progress, or after close().
  const std::optional<Error>& restore_error() const noexcept { return restore_error_; }
  const LinkCounts& packets() const noexcept { return counts_; }
  std::uint64_t states_missed() const noexcept { return states_missed_; }
  std::uint64_t sessions() const noexcept { return sessions_; }
  std::optional<LinkReport> link_report() const override {
    return LinkReport{sessions_, LinkPackets{counts_, states_missed_}, round_trip_, restore_error_};
  }

 protected:
  UdpLink(const UdpDeviceOptions& options, UdpSocket socket)
      : options_(options), socket_(std::move(socket)) {}
  const typename Kind::State& newest() const noexcept { return newest_; }

 private:
  Result<void> shake_hands(bool fresh);
  /// Calls shake_hands() as a part of restore(), and stores the error in restore_error_.
  bool shake_hands_again();
  void restore_when_requested();
  DeviceStatus status_of_newest() const noexcept;
  /// Takes the waiting datagrams, at most kMaxDatagrams. Returns false if the other end is closed.
  bool drain() noexcept;
  UdpSocket::Outcome send(CommandMode mode, const Output& torques) noexcept;
  void note_round_trip() noexcept;

  /// Largest number of datagrams taken in one tick, so that a flood cannot delay it.
  static constexpr int kMaxDatagrams = 512;
  /// If more states than this were queued, the socket may have dropped the newest. A socket's
  /// buffer holds about 270.
  static constexpr int kLongQueue = 128;
  /// Number of commands whose round trip can be measured at the same time.
  static constexpr std::size_t kRoundTrips = 256;

  UdpDeviceOptions options_;
  UdpSocket socket_;
  LinkKey session_key_;
  std::uint64_t session_ = 0, last_command_ = 0, last_state_ = 0;
  typename Kind::State newest_;
  bool fresh_state_ = false;
  int queued_ = 0;              ///< number of states that the last drain() took
  std::int64_t newest_ns_ = 0;  ///< arrival time of newest_
  bool has_written_ = false;    ///< torques were sent in this session
  LinkCounts counts_;
  LinkRefusal last_refusal_ = LinkRefusal::kNone;  ///< the result for this session's last packet
  std::uint64_t states_missed_ = 0, sessions_ = 0;
  Histogram round_trip_;                             ///< LinkReport::round_trip
  std::array<std::int64_t, kRoundTrips> sent_ns_{};  ///< time of each of the latest commands
  std::uint64_t last_acknowledged_ = 0;  ///< the latest command that a state acknowledged
  bool counts_missed_ = false;           ///< states missed from now on are counted
  bool answers_come_ = true;             ///< lock-step: the last answer arrived in time
  bool is_lost_ = false;                 ///< the last read() returned kLinkLost or kMotorFault
  bool given_up_ = false;                ///< lock-step: restore() failed
  std::optional<Error> restore_error_;
  /// While this is set, the restoring thread owns all other members; otherwise the
  /// haptic thread does.
  std::atomic<bool> restoring_{false};
  std::atomic<bool> closing_{false};
  static_assert(std::atomic<bool>::is_always_lock_free);
  std::thread restorer_;  ///< used with the real clock only
};

extern template class UdpLink<AngleDrive>;
extern template class UdpLink<PoseDrive>;

/// Opens the socket to a drive. Errors: (device fault) it cannot be opened.
Result<UdpSocket> open_link_socket(const UdpDeviceOptions& options);

}  // namespace trocar::runtime
