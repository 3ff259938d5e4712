// SPDX-License-Identifier: Apache-2.0
// The host's end of the device link, and the UDP socket under it.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <thread>
#include <utility>

#include "formats/base/files.h"
#include "formats/base/result.h"
#include "formats/session/device_protocol.h"
#include "runtime/device/device.h"
#include "runtime/device/pose_device.h"

namespace trocar::runtime {

// A non-blocking IPv4 datagram socket (UDP), and its addresses. After a socket has been made, each
// of its functions makes at most one system call, and none allocates or throws. Only wait() blocks.

struct Endpoint {
  std::uint32_t address = 0;  ///< in the machine's byte order; 0x7f000001 is 127.0.0.1
  std::uint16_t port = 0;
  bool is_loopback() const noexcept { return address >> 24 == 127; }
  friend bool operator==(const Endpoint&, const Endpoint&) = default;
};
std::string to_string(const Endpoint& endpoint);

/// Parses HOST:PORT. HOST is a dotted IPv4 address, or a name whose IPv4 address is looked up.
/// Errors: kUsage if `text` has another form, the name is unknown, or the port is below
/// `lowest_port`; the message quotes `text`. If `lowest_port` is 0, port 0 is allowed: the system
/// then chooses a port to listen on.
Result<Endpoint> parse_endpoint(std::string_view text, int lowest_port);

class UdpSocket {
 public:
  /// Opens a socket bound to `local`. Errors: kUnwritable if the address is not available.
  static Result<UdpSocket> listen(const Endpoint& local);
  /// Opens a socket that sends to `peer` and receives from `peer` only. Errors: kDeviceFault if the
  /// system refuses the socket.
  static Result<UdpSocket> connect(const Endpoint& peer);

  enum class Outcome : std::uint8_t {
    kDone,
    kNothing,  ///< no datagram is waiting, or the send buffer is full
    kGone,     ///< the other end is closed, or the socket failed
  };
  /// Receives one datagram into `buffer`. On kDone, `bytes` is the datagram's full length, even if
  /// the buffer is shorter, and `from` is the sender.
  Outcome receive(std::span<std::uint8_t> buffer, std::size_t& bytes, Endpoint& from) noexcept;
  /// Sends a datagram to the peer of connect().
  Outcome send(std::span<const std::uint8_t> datagram) noexcept;
  Outcome send_to(std::span<const std::uint8_t> datagram, const Endpoint& to) noexcept;
  /// Waits at most `seconds` for a datagram. Returns false if none has arrived, or if a signal
  /// has interrupted the wait.
  bool wait(double seconds) noexcept;
  /// Returns the address and port to which the socket is bound.
  Endpoint local() const noexcept;
  /// errno of the last operation that returned Outcome::kGone; 0 if none did.
  int error() const noexcept { return error_; }

 private:
  explicit UdpSocket(int fd) : fd_(fd) {}
  Outcome outcome_of(std::int64_t done) noexcept;
  FileDescriptor fd_;
  int error_ = 0;
};

// The host's end of the device link, the UDP protocol between the haptic loop and a drive (the
// electronics with the motors; formats/session/device_link.md). The host sends commands, and the
// drive sends states, which contain its measurements. There are two kinds of drives, with one class
// for each kind: UdpDevice for the four-legged device, and UdpPoseDevice for a device that measures
// its own pose.
// read() and write() do not block, allocate, lock or throw. Packets that are old or not authentic
// are counted and otherwise ignored.
//
// In this header, "session" means a session of the link. It begins with the handshake (hello,
// welcome, first state), and ends when it is closed or lost. After a loss, restore() requests a new
// session. With the real clock, a separate thread establishes the new session. Until it has done
// so, no other thread uses the socket. In lock-step (the drive's time advances only by the loop's
// commands) advance() establishes the new session.

struct UdpLinkOptions {
  Endpoint peer;
  LinkKey key;
  /// Period of the loop. In lock-step, each command advances the drive's time by this period.
  double period_s = 1e-3;
  LinkClock clock = LinkClock::kReal;  ///< the drive must use the same clock
  bool resets_world = true;            ///< start() asks a simulated drive to restart its simulation
  double connect_timeout_s = 5;
  /// With the real clock, the link counts as lost after this time without a state, or after 2.5
  /// periods if they are longer. For lock-step, see answer_s.
  double no_state_s = 0.01;
  /// In lock-step, the longest wait for the drive's answer to a command. If an answer is missed,
  /// the longest wait is only no_state_s until an answer arrives in time again.
  double answer_s = 2;
  /// Receives the reason, in one line, if an attempt of restore() fails. A repeated reason is said
  /// only once. Never called in the haptic thread with the real clock. May be empty.
  std::function<void(const std::string& line)> say;
};

/// A drive that reports the angles of the four-legged device and takes torques.
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

/// A drive that reports the pose of a handle and takes a wrench.
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

/// `Kind` is AngleDrive or PoseDrive. In the comments below, "torques" also means the
/// wrench of a PoseDrive.
template <typename Kind>
class UdpLink final : public Kind::Interface {
 public:
  using Reading = typename Kind::Reading;
  using Output = typename Kind::Output;

  /// Opens the socket. No packet is sent before start(). Errors: kDeviceFault if the socket cannot
  /// be opened; kBug if the system has no source of randomness.
  static Result<std::unique_ptr<UdpLink>> make(const UdpLinkOptions& options);
  /// Calls close().
  ~UdpLink() override;
  UdpLink(const UdpLink&) = delete;
  UdpLink& operator=(const UdpLink&) = delete;

  /// Establishes a session: hello, welcome and a first state. Blocks for at most connect_timeout_s.
  /// Errors: kDeviceFault if the drive does not answer, has another key or protocol version, is in
  /// a session with another host, is not of the kind `Kind` or sends no valid state, or if another
  /// program answers; kUsage if the drive uses another clock, or sends more than
  /// kMostStatesPerPeriod states in a period of the loop; kBug if start() was called before (with
  /// the real clock only; in lock-step the function does not detect this).
  Result<void> start() override;
  /// Ends the session on both sides, and stops a restore() in progress. The counts of packets can
  /// still be read afterwards.
  void close() override;

  /// Reads the newest state that has arrived since the last call. Below, the silence limit is
  /// no_state_s or 2.5 periods, whichever is longer.
  ///  - kNoData: no state has arrived since the last call, but one has arrived within the silence
  ///    limit. read() also returns kNoData if at least kLongQueue states were queued, and at least
  ///    twice the states of a period, for example after a slow start of the loop, unless the newest
  ///    reports the emergency stop. The socket may then have dropped newer states than the queued
  ///    ones.
  ///  - kLinkLost, in five cases: no state has arrived for longer than the silence limit (in
  ///    lock-step: since the last call); the other end is closed; the drive has received none of
  ///    the torques that were sent within the silence limit; the drive's watchdog has set the
  ///    torques to zero, because commands stopped arriving; or a restore() is in progress.
  ///    refused_contents() then says whether states do arrive but are refused.
  ///  - kEmergencyStop, kMotorFault: the drive reports this condition.
  DeviceStatus read(Reading& reading) noexcept override;
  /// Sends torques. Returns kLinkLost if the other end is closed or a restore() is in progress.
  /// Returns kNoData, and sends nothing, if a torque is not finite or exceeds the protocol's limit,
  /// or if the socket's buffer is full.
  DeviceStatus write(const Output& torques) noexcept override;
  std::uint8_t fault_byte() const noexcept override { return Kind::faults(newest_); }
  /// In lock-step, calls wait_for_answer().
  void advance(double /*dt_s*/) noexcept override {
    if (options_.clock == LinkClock::kLockStep) wait_for_answer();
  }
  bool is_paced_by_loop() const noexcept override { return options_.clock == LinkClock::kLockStep; }

  /// Call this in lock-step only. Waits for the answer to the last write(), for at most the time
  /// that UdpLinkOptions::answer_s defines. Returns false if no answer arrives. The next read()
  /// returns the answer, or kLinkLost if there is none. If restore() has requested a new session,
  /// there is no answer to wait for: the function then establishes the session within
  /// connect_timeout_s, or returns false.
  bool wait_for_answer() noexcept;

  /// Requests a new session with the drive at the same address. A simulated drive continues its
  /// simulation without a restart. With the real clock, attempts are repeated until one succeeds,
  /// with a pause after each failure. In lock-step there is one attempt of at most
  /// connect_timeout_s. If this attempt fails, further requests have no effect. Until the new
  /// session begins, torques are zero, and read() and write() return kLinkLost. The request has an
  /// effect only if the last read() returned kLinkLost or kMotorFault. (A motor fault also needs a
  /// new session, because the drive reports the fault until the present session ends.)
  void restore() noexcept override;

  FaultDetail refused_contents() const noexcept override { return refused_.get(); }

  // Call the following functions only while no restore() is in progress, or after close().
  const std::optional<Error>& restore_error() const noexcept { return restore_error_; }
  const LinkCounts& packets() const noexcept { return counts_; }
  std::uint64_t sessions() const noexcept { return sessions_; }
  std::optional<LinkReport> link_report() const override {
    return LinkReport{sessions_, LinkPackets{counts_, states_missed_}, round_trip_, restore_error_};
  }

 private:
  UdpLink(const UdpLinkOptions& options, UdpSocket socket)
      : options_(options), socket_(std::move(socket)) {}
  Result<void> shake_hands(bool resets_world);
  /// Calls shake_hands() as a part of restore(). Returns true on success. After a failure,
  /// restore_error_ contains the error, unless close() caused the failure.
  bool shake_hands_again();
  void restore_when_requested();
  DeviceStatus status_of_newest() const noexcept;
  double silence_max_s() const noexcept;
  /// Receives the datagrams that wait in the socket, at most kMaxDatagrams. Returns false if the
  /// other end is closed.
  bool drain() noexcept;
  UdpSocket::Outcome send(CommandMode mode, const Output& torques) noexcept;
  void note_round_trip() noexcept;

  /// Largest number of datagrams that one drain() receives, so that a flood of datagrams cannot
  /// delay the tick.
  static constexpr int kMaxDatagrams = 512;
  /// If at least this many states were queued, the socket may have dropped the newest. A socket's
  /// buffer holds about 270 states, so twice kMostStatesPerPeriod still fit.
  static constexpr int kLongQueue = 128;
  static constexpr double kMostStatesPerPeriod = 128;
  /// Number of the latest commands whose sending times are kept. If a state acknowledges an older
  /// command, no round trip is measured.
  static constexpr std::size_t kRoundTrips = 256;

  UdpLinkOptions options_;
  UdpSocket socket_;
  LinkKey session_key_;
  std::uint64_t session_ = 0, last_command_ = 0, last_state_ = 0;
  typename Kind::State newest_;
  /// The number of queued states from which on read() discards them.
  double long_queue_ = kLongQueue;
  bool fresh_state_ = false;
  int queued_ = 0;              ///< number of states that the last drain() received
  std::int64_t newest_ns_ = 0;  ///< arrival time of newest_
  bool has_written_ = false;    ///< torques were sent in this session
  LinkCounts counts_;
  LinkRefusal last_refusal_ = LinkRefusal::kNone;  ///< result of decoding the session's last packet
  std::uint64_t states_missed_ = 0, sessions_ = 0;
  Histogram round_trip_;                             ///< LinkReport::round_trip
  std::array<std::int64_t, kRoundTrips> sent_ns_{};  ///< sending times of the latest commands
  std::uint64_t last_acknowledged_ = 0;              ///< number of the latest acknowledged command
  bool counts_missed_ = false;                       ///< true: states_missed_ counts missed states
  bool answers_come_ = true;                         ///< lock-step: the last answer arrived in time
  bool is_lost_ = false;   ///< the last read() returned kLinkLost or kMotorFault
  bool given_up_ = false;  ///< lock-step: restore() failed
  std::optional<Error> restore_error_;
  std::string refused_field_;  ///< quantity_name() of the field that restore_error_ names
  RefusedContents refused_;    ///< of the newest authentic state
  /// While this is true, only the thread that establishes the new session uses the other members.
  /// While this is false, only the haptic thread does.
  std::atomic<bool> restoring_{false};
  std::atomic<bool> closing_{false};
  static_assert(std::atomic<bool>::is_always_lock_free);
  std::thread restorer_;  ///< used with the real clock only
};

extern template class UdpLink<AngleDrive>;
extern template class UdpLink<PoseDrive>;

using UdpDevice = UdpLink<AngleDrive>;
using UdpPoseDevice = UdpLink<PoseDrive>;

}  // namespace trocar::runtime
