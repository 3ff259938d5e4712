// SPDX-License-Identifier: Apache-2.0
#include "runtime/link/udp_device.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <ctime>
#include <string>
#include <utility>

#include "formats/base/system_message.h"

namespace trocar::runtime {
namespace {

constexpr double kHelloPeriod_s = 0.05;
constexpr auto kRequestPoll = std::chrono::milliseconds(5);

std::int64_t now_ns() noexcept {
  timespec now{};
  ::clock_gettime(CLOCK_MONOTONIC, &now);
  return now.tv_sec * std::int64_t{1'000'000'000} + now.tv_nsec;
}

double since_s(std::int64_t then_ns) noexcept {
  return static_cast<double>(now_ns() - then_ns) * 1e-9;
}

}  // namespace

Result<std::unique_ptr<UdpDevice>> UdpDevice::make(const UdpDeviceOptions& options) {
  if (Result<void> started = start_link(); !started) return started.error();
  Result<UdpSocket> socket = UdpSocket::connect(options.peer);
  if (!socket) return socket.error();
  return std::unique_ptr<UdpDevice>(new UdpDevice(options, std::move(*socket)));
}

Result<std::unique_ptr<UdpDevice>> UdpDevice::connect(const UdpDeviceOptions& options) {
  Result<std::unique_ptr<UdpDevice>> device = make(options);
  if (!device) return device;
  if (Result<void> started = (*device)->start(); !started) return started.error();
  return device;
}

Result<void> UdpDevice::start() {
  if (restorer_.joinable()) return bug("a device is started once");
  if (Result<void> done = shake_hands(options_.fresh); !done) return done;
  if (options_.clock == LinkClock::kReal) {
    restorer_ = std::thread([this] { restore_when_requested(); });
  }
  return {};
}

UdpDevice::~UdpDevice() {
  UdpDevice::close();
}

void UdpDevice::close() {
  closing_.store(true);
  if (restorer_.joinable()) restorer_.join();
  if (session_ != 0) send(CommandMode::kStop, {});
  session_ = 0;
}

void UdpDevice::restore() noexcept {
  if (!is_lost_ || given_up_) return;
  is_lost_ = false;
  restoring_.store(true, std::memory_order_release);
}

void UdpDevice::restore_when_requested() {
  while (!closing_.load()) {
    if (restoring_.load(std::memory_order_acquire)) {
      if (shake_hands_again()) {
        restoring_.store(false, std::memory_order_release);
      } else {
        // The pause is needed because an attempt may fail at once.
        std::this_thread::sleep_for(std::chrono::duration<double>(kHelloPeriod_s));
      }
    } else {
      std::this_thread::sleep_for(kRequestPoll);
    }
  }
}

bool UdpDevice::shake_hands_again() {
  const Result<void> done = shake_hands(false);
  if (done) {
    restore_error_.reset();
  } else if (!closing_.load()) {  // it is no error if close() interrupts an attempt
    restore_error_ = done.error();
  }
  return static_cast<bool>(done);
}

/// Observations in an attempt to reach the drive. The error message is made from them.
struct UdpDevice::Attempt {
  LinkNonce nonce{};
  bool welcomed = false, wrong_key = false, busy = false;
  bool other_program = false, other_version = false;

  /// Evaluates a datagram that is not a welcome.
  void note(std::span<const std::uint8_t> datagram) noexcept {
    constexpr std::size_t kVersionAt = 4;  // the version follows the magic
    DenialPacket denial;
    if (decode(datagram, nonce, denial) == LinkRefusal::kNone) {
      wrong_key = wrong_key || denial.reason == DenialReason::kKey;
      busy = busy || denial.reason == DenialReason::kBusy;
      return;
    }
    LinkNonce ignored;
    const bool is_link = datagram.size() > kVersionAt &&
                         std::equal(kLinkMagic.begin(), kLinkMagic.end(), datagram.begin());
    other_version = other_version || (is_link && datagram[kVersionAt] != kLinkVersion);
    // A program that echoes datagrams sends back the hello.
    other_program = other_program || !is_link || hello_nonce(datagram, ignored);
  }

  std::string why(int socket_error) const {
    // This also happens if another host's session began between the welcome and the first command.
    if (welcomed) {
      return "the device answered but sends no states; end another host's session with it, or "
             "restart it";
    }
    if (wrong_key) {
      return "the device there has another key; --key-file must be a copy of the file that it was "
             "started with";
    }
    if (busy) return "the device there is in a session with another host; end that one first";
    if (other_version) return "the device there speaks another version of the device link";
    if (other_program) {
      return "another program answers there, not a device; check the address and the port";
    }
    if (socket_error == ECONNREFUSED) {
      return "no device answers there: nothing listens on this port; start the device, or check "
             "the port";
    }
    if (socket_error != 0) {
      return "no device answers there: " + system_message(socket_error);
    }
    return "no device answers there: the host is off or cannot be reached (address, cable, "
           "firewall), or its device is of an older version and has another key";
  }
};

Result<void> UdpDevice::shake_hands(bool fresh) {
  // End an old session, or an earlier attempt at a new one.
  if (session_ != 0) send(CommandMode::kStop, {});
  const std::int64_t start_ns = now_ns();
  HelloPacket hello;
  hello.host_nonce = random_nonce();
  hello.period_s = options_.period_s;
  hello.fresh = fresh;
  std::array<std::uint8_t, kMaxPacketBytes> buffer{};
  WelcomePacket welcome;
  Attempt attempt;
  attempt.nonce = hello.host_nonce;
  std::int64_t asked_ns = 0;
  std::size_t bytes = 0;
  Endpoint from;
  const auto in_time = [&] {
    return since_s(start_ns) < options_.connect_timeout_s && !closing_.load();
  };
  const auto no_answer = [&] {
    return Error{ExitCode::kDeviceFault,
                 to_string(options_.peer) + ": " + attempt.why(socket_.error())};
  };
  while (!attempt.welcomed) {
    if (!in_time()) return no_answer();
    if (asked_ns == 0 || since_s(asked_ns) > kHelloPeriod_s) {
      asked_ns = now_ns();
      hello.time_ns = asked_ns;
      const std::size_t size = encode(hello, options_.key, buffer);
      socket_.send(std::span(buffer).first(size));
    }
    socket_.wait(kHelloPeriod_s);
    while (!attempt.welcomed && socket_.receive(buffer, bytes, from) == UdpSocket::Outcome::kDone) {
      const auto datagram = std::span(buffer).first(std::min(bytes, buffer.size()));
      if (bytes > buffer.size() || claimed_kind(datagram) != PacketKind::kWelcome) {
        attempt.note(datagram);
        continue;
      }
      const LinkRefusal refusal = decode(datagram, options_.key, hello.host_nonce, welcome);
      counts_.add(refusal);
      attempt.welcomed = refusal == LinkRefusal::kNone;
    }
  }
  if (welcome.clock != options_.clock) {
    return usage(to_string(options_.peer) +
                 (welcome.clock == LinkClock::kLockStep
                      ? ": this device runs in lock-step; use --clock virtual"
                      : ": this device runs by its own clock; use --clock real"));
  }
  session_key_ = session_key(options_.key, welcome.host_nonce, welcome.drive_nonce);
  session_ = session_number(welcome.drive_nonce);
  last_command_ = last_state_ = last_acknowledged_ = 0;
  newest_ = {};
  fresh_state_ = has_written_ = counts_missed_ = false;
  // The first command begins the session. It is repeated, because it may be lost.
  for (asked_ns = 0; !fresh_state_; socket_.wait(1e-3)) {
    if (!in_time()) return no_answer();
    if (asked_ns == 0 || since_s(asked_ns) > kHelloPeriod_s) {
      asked_ns = now_ns();
      send(CommandMode::kHold, {});
    }
    drain();
  }
  answers_come_ = true;
  ++sessions_;
  return {};
}

UdpSocket::Outcome UdpDevice::send(CommandMode mode, const DeviceCommand& command) noexcept {
  CommandPacket packet;
  packet.session = session_;
  packet.sequence = last_command_ + 1;
  packet.time_ns = now_ns();
  packet.mode = mode;
  packet.state_seen = last_state_;
  packet.tau_motor_Nm = command.tau_motor_Nm;
  std::array<std::uint8_t, kCommandBytes> bytes;
  if (encode(packet, session_key_, bytes) == 0) return UdpSocket::Outcome::kNothing;
  ++last_command_;
  sent_ns_[last_command_ % kRoundTrips] = packet.time_ns;
  return socket_.send(bytes);
}

/// Measures the round trip of the command that the newest state acknowledges, if no earlier state did.
void UdpDevice::note_round_trip() noexcept {
  const std::uint64_t taken = newest_.command_taken;
  if (taken <= last_acknowledged_ || taken > last_command_ || last_command_ - taken >= kRoundTrips)
    return;
  last_acknowledged_ = taken;
  if (options_.clock == LinkClock::kReal)
    round_trip_.add(newest_ns_ - sent_ns_[taken % kRoundTrips]);
}

bool UdpDevice::drain() noexcept {
  std::array<std::uint8_t, kMaxPacketBytes> buffer;
  queued_ = 0;
  for (int i = 0; i < kMaxDatagrams; ++i) {
    std::size_t bytes = 0;
    Endpoint from;
    switch (socket_.receive(buffer, bytes, from)) {
      case UdpSocket::Outcome::kNothing:
        counts_missed_ = has_written_;
        return true;
      case UdpSocket::Outcome::kGone:
        return false;
      case UdpSocket::Outcome::kDone:
        break;
    }
    if (bytes > buffer.size()) {
      counts_.add(LinkRefusal::kSize);
      continue;
    }
    // A denial here answers a hello that was repeated while its welcome was in transit.
    if (claimed_kind(std::span(buffer).first(bytes)) == PacketKind::kDenial) continue;
    const std::uint64_t before = last_state_;
    const LinkRefusal refusal =
        decode(std::span(buffer).first(bytes), session_key_, session_, last_state_, newest_);
    counts_.add(refusal);
    if (refusal == LinkRefusal::kNone) {
      if (counts_missed_) states_missed_ += last_state_ - before - 1;
      fresh_state_ = true;
      ++queued_;
      newest_ns_ = now_ns();
      note_round_trip();
    }
  }
  return true;
}

DeviceStatus UdpDevice::read(DeviceState& state) noexcept {
  if (restoring_.load(std::memory_order_acquire)) return DeviceStatus::kLinkLost;
  const bool open = drain();
  if (!fresh_state_) {
    is_lost_ = !open || options_.clock == LinkClock::kLockStep ||
               since_s(newest_ns_) > options_.no_state_s;
    return is_lost_ ? DeviceStatus::kLinkLost : DeviceStatus::kNoData;
  }
  fresh_state_ = false;
  if (queued_ >= kLongQueue) return DeviceStatus::kNoData;
  const DeviceStatus status = status_of_newest();
  is_lost_ = status == DeviceStatus::kLinkLost || status == DeviceStatus::kMotorFault;
  if (status != DeviceStatus::kOk) return status;
  state.t_s = static_cast<double>(newest_.time_ns) / 1e9;
  state.encoder_rad = newest_.encoder_rad;
  return status;
}

DeviceStatus UdpDevice::status_of_newest() const noexcept {
  if (newest_.mode == DriveMode::kEmergencyStop) return DeviceStatus::kEmergencyStop;
  if (newest_.motor_faults != 0) return DeviceStatus::kMotorFault;
  if (!has_written_) return DeviceStatus::kOk;
  // The state contains the number of the last command that the drive has received.
  const std::uint64_t not_received = last_command_ - std::min(last_command_, newest_.command_taken);
  const bool receives_nothing = static_cast<double>(not_received) * options_.period_s >
                                std::max(options_.no_state_s, 2.5 * options_.period_s);
  return receives_nothing || newest_.mode == DriveMode::kWatchdog ? DeviceStatus::kLinkLost
                                                                  : DeviceStatus::kOk;
}

DeviceStatus UdpDevice::write(const DeviceCommand& command) noexcept {
  if (restoring_.load(std::memory_order_acquire)) return DeviceStatus::kLinkLost;
  switch (send(CommandMode::kTorque, command)) {
    case UdpSocket::Outcome::kDone:
      has_written_ = true;
      return DeviceStatus::kOk;
    case UdpSocket::Outcome::kNothing:
      return DeviceStatus::kNoData;
    case UdpSocket::Outcome::kGone:
      break;
  }
  return DeviceStatus::kLinkLost;
}

bool UdpDevice::wait_for_answer() noexcept {
  if (restoring_.load(std::memory_order_acquire)) {
    given_up_ = !shake_hands_again();
    restoring_.store(false, std::memory_order_release);
    return !given_up_;
  }
  const std::int64_t start_ns = now_ns();
  const double longest_s = answers_come_ ? options_.answer_s : options_.no_state_s;
  answers_come_ = false;
  while (newest_.command_taken != last_command_ || !fresh_state_) {
    const double left_s = longest_s - since_s(start_ns);
    if (left_s <= 0 || !socket_.wait(left_s) || !drain()) return false;
  }
  answers_come_ = true;
  return true;
}

}  // namespace trocar::runtime
