// SPDX-License-Identifier: Apache-2.0
#include "runtime/link/udp_link.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <string>
#include <utility>

#include "formats/base/text_line.h"
#include "runtime/link/link_attempt.h"
#include "runtime/realtime/monotonic_clock.h"

namespace trocar::runtime {
namespace {

constexpr double kHelloPeriod_s = 0.05;
constexpr auto kRequestPoll = std::chrono::milliseconds(5);

double since_s(std::int64_t then_ns) noexcept {
  return static_cast<double>(monotonic_ns() - then_ns) * 1e-9;
}

}  // namespace

void AngleDrive::unpack(const State& state, Reading& reading) noexcept {
  reading.t_s = static_cast<double>(state.time_ns) / 1e9;
  reading.encoder_rad = state.encoder_rad;
}
void AngleDrive::pack(const Output& torques, Command& command) noexcept {
  command.tau_motor_Nm = torques.tau_motor_Nm;
}

void PoseDrive::unpack(const State& state, Reading& reading) noexcept {
  reading = {static_cast<double>(state.time_ns) / 1e9, state.p_m, state.q, state.buttons};
}
void PoseDrive::pack(const Output& wrench, Command& command) noexcept {
  std::copy_n(wrench.begin(), 3, command.force_N.begin());
  std::copy_n(wrench.begin() + 3, 3, command.moment_Nm.begin());
}

template <typename Kind>
Result<std::unique_ptr<UdpLink<Kind>>> UdpLink<Kind>::make(const UdpLinkOptions& options) {
  if (Result<void> started = start_link(); !started) return started.error();
  Result<UdpSocket> socket = UdpSocket::connect(options.peer);
  if (!socket) return socket.error();
  return std::unique_ptr<UdpLink>(new UdpLink(options, std::move(*socket)));
}

template <typename Kind>
Result<void> UdpLink<Kind>::start() {
  if (restorer_.joinable()) return bug("a device is started once");
  if (Result<void> done = shake_hands(options_.resets_world); !done) return done;
  if (options_.clock == LinkClock::kReal) {
    restorer_ = std::thread([this] { restore_when_requested(); });
  }
  return {};
}

template <typename Kind>
UdpLink<Kind>::~UdpLink() {
  UdpLink::close();
}

template <typename Kind>
void UdpLink<Kind>::close() {
  closing_.store(true);
  if (restorer_.joinable()) restorer_.join();
  if (session_ != 0) send(CommandMode::kStop, {});
  session_ = 0;
}

template <typename Kind>
void UdpLink<Kind>::restore() noexcept {
  if (!is_lost_ || given_up_) return;
  is_lost_ = false;
  restoring_.store(true, std::memory_order_release);
}

template <typename Kind>
void UdpLink<Kind>::restore_when_requested() {
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

template <typename Kind>
bool UdpLink<Kind>::shake_hands_again() {
  const Result<void> done = shake_hands(false);
  if (done) {
    restore_error_.reset();
  } else if (!closing_.load()) {  // it is no error if close() interrupts an attempt
    // The value of a refused field may differ in each state, which is no new reason.
    const std::string field = quantity_name(refused_.get());
    const bool is_same_field = !field.empty() && field == refused_field_;
    const bool is_new =
        !restore_error_ || (!is_same_field && restore_error_->message != done.error().message);
    refused_field_ = field;
    restore_error_ = done.error();
    if (is_new && options_.say) options_.say(restore_error_->message);
  }
  return static_cast<bool>(done);
}

template <typename Kind>
Result<void> UdpLink<Kind>::shake_hands(bool resets_world) {
  // End an old session, or an earlier attempt at a new one.
  if (session_ != 0) send(CommandMode::kStop, {});
  const std::int64_t start_ns = monotonic_ns();
  HelloPacket hello;
  hello.host_nonce = random_nonce();
  hello.period_s = options_.period_s;
  hello.resets_world = resets_world;
  hello.contents = Kind::kContents;
  std::array<std::uint8_t, kMaxPacketBytes> buffer{};
  WelcomePacket welcome;
  LinkAttempt attempt;
  attempt.nonce = hello.host_nonce;
  std::int64_t asked_ns = 0;
  std::size_t bytes = 0;
  Endpoint from;
  const auto in_time = [&] {
    return since_s(start_ns) < options_.connect_timeout_s && !closing_.load();
  };
  const auto no_answer = [&] {
    if (!attempt.welcomed) refused_.set({});
    return Error{ExitCode::kDeviceFault,
                 to_string(options_.peer) + ": " + attempt.why(socket_.error(), Kind::kContents)};
  };
  while (!attempt.welcomed) {
    if (!in_time()) return no_answer();
    if (asked_ns == 0 || since_s(asked_ns) > kHelloPeriod_s) {
      asked_ns = monotonic_ns();
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
                      ? ": this device runs in lock-step; use --clock virtual (for a test, start "
                        "the device with --clock real)"
                      : ": this device runs by its own clock; use --clock real"));
  }
  const double states = std::round(options_.period_s / welcome.period_s);
  if (options_.clock == LinkClock::kReal && states > kMostStatesPerPeriod) {
    return usage(
        text_line("%s: this device sends %.0f states in each tick, and at most %.0f can "
                  "be read; use a higher --rate, or let the device send fewer",
                  to_string(options_.peer).c_str(), states, kMostStatesPerPeriod));
  }
  long_queue_ = std::max(double{kLongQueue}, 2 * states);
  session_key_ = session_key(options_.key, welcome.host_nonce, welcome.drive_nonce);
  session_ = session_number(welcome.drive_nonce);
  last_command_ = last_state_ = last_acknowledged_ = 0;
  newest_ = {};
  fresh_state_ = has_written_ = counts_missed_ = false;
  last_refusal_ = LinkRefusal::kNone;
  // The first command begins the session. It is repeated, because it may be lost.
  for (asked_ns = 0; !fresh_state_; socket_.wait(1e-3)) {
    if (!in_time()) {
      attempt.state_refusal = last_refusal_;
      attempt.refused = refused_.get();
      return no_answer();
    }
    if (asked_ns == 0 || since_s(asked_ns) > kHelloPeriod_s) {
      asked_ns = monotonic_ns();
      send(CommandMode::kFree, {});
    }
    drain();
  }
  answers_come_ = true;
  ++sessions_;
  return {};
}

template <typename Kind>
UdpSocket::Outcome UdpLink<Kind>::send(CommandMode mode, const Output& torques) noexcept {
  typename Kind::Command packet;
  packet.session = session_;
  packet.sequence = last_command_ + 1;
  packet.time_ns = monotonic_ns();
  packet.mode = mode;
  packet.state_seen = last_state_;
  Kind::pack(torques, packet);
  std::array<std::uint8_t, kMaxPacketBytes> bytes;
  const std::size_t size = encode(packet, session_key_, bytes);
  if (size == 0) return UdpSocket::Outcome::kNothing;
  ++last_command_;
  sent_ns_[last_command_ % kRoundTrips] = packet.time_ns;
  return socket_.send(std::span(bytes).first(size));
}

/// Measures the round trip of the command that the newest state acknowledges, if no earlier state did.
template <typename Kind>
void UdpLink<Kind>::note_round_trip() noexcept {
  const std::uint64_t taken = newest_.command_taken;
  if (taken <= last_acknowledged_ || taken > last_command_ || last_command_ - taken >= kRoundTrips)
    return;
  last_acknowledged_ = taken;
  if (options_.clock == LinkClock::kReal)
    round_trip_.add(newest_ns_ - sent_ns_[taken % kRoundTrips]);
}

template <typename Kind>
bool UdpLink<Kind>::drain() noexcept {
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
      counts_.add(last_refusal_ = LinkRefusal::kSize);
      continue;
    }
    // A denial here answers a hello that was repeated while its welcome was in transit.
    const PacketKind kind = claimed_kind(std::span(buffer).first(bytes));
    if (kind == PacketKind::kDenial) continue;
    const std::uint64_t before = last_state_;
    FaultDetail refused;
    const LinkRefusal refusal = decode(std::span(buffer).first(bytes), session_key_, session_,
                                       last_state_, newest_, refused);
    counts_.add(refusal);
    // A late welcome says nothing about the states.
    if (kind != PacketKind::kWelcome) last_refusal_ = refusal;
    if (refusal == LinkRefusal::kContents || refusal == LinkRefusal::kNone) refused_.set(refused);
    if (refusal == LinkRefusal::kNone) {
      if (counts_missed_) states_missed_ += last_state_ - before - 1;
      fresh_state_ = true;
      ++queued_;
      newest_ns_ = monotonic_ns();
      note_round_trip();
    }
  }
  return true;
}

template <typename Kind>
DeviceStatus UdpLink<Kind>::read(Reading& reading) noexcept {
  if (restoring_.load(std::memory_order_acquire)) return DeviceStatus::kLinkLost;
  const bool open = drain();
  if (!fresh_state_) {
    is_lost_ =
        !open || options_.clock == LinkClock::kLockStep || since_s(newest_ns_) > silence_max_s();
    return is_lost_ ? DeviceStatus::kLinkLost : DeviceStatus::kNoData;
  }
  fresh_state_ = false;
  DeviceStatus status = status_of_newest();
  // A stop counts in any queue: the next command would acknowledge it.
  if (queued_ >= long_queue_ && status != DeviceStatus::kEmergencyStop)
    status = DeviceStatus::kNoData;
  is_lost_ = status == DeviceStatus::kLinkLost || status == DeviceStatus::kMotorFault;
  if (status != DeviceStatus::kOk) return status;
  Kind::unpack(newest_, reading);
  return status;
}

/// Returns the longest time in which nothing arrives at either end of a link that works.
template <typename Kind>
double UdpLink<Kind>::silence_max_s() const noexcept {
  return std::max(options_.no_state_s, 2.5 * options_.period_s);
}

template <typename Kind>
DeviceStatus UdpLink<Kind>::status_of_newest() const noexcept {
  if (newest_.mode == DriveMode::kEmergencyStop) return DeviceStatus::kEmergencyStop;
  if (Kind::faults(newest_) != 0) return DeviceStatus::kMotorFault;
  if (!has_written_) return DeviceStatus::kOk;
  // The state contains the number of the last command that the drive has received.
  const std::uint64_t not_received = last_command_ - std::min(last_command_, newest_.command_taken);
  const bool receives_nothing =
      static_cast<double>(not_received) * options_.period_s > silence_max_s();
  return receives_nothing || newest_.mode == DriveMode::kWatchdog ? DeviceStatus::kLinkLost
                                                                  : DeviceStatus::kOk;
}

template <typename Kind>
DeviceStatus UdpLink<Kind>::write(const Output& torques) noexcept {
  if (restoring_.load(std::memory_order_acquire)) return DeviceStatus::kLinkLost;
  switch (send(CommandMode::kTorque, torques)) {
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

template <typename Kind>
bool UdpLink<Kind>::wait_for_answer() noexcept {
  if (restoring_.load(std::memory_order_acquire)) {
    given_up_ = !shake_hands_again();
    restoring_.store(false, std::memory_order_release);
    return !given_up_;
  }
  const std::int64_t start_ns = monotonic_ns();
  const double longest_s = answers_come_ ? options_.answer_s : options_.no_state_s;
  answers_come_ = false;
  while (newest_.command_taken != last_command_ || !fresh_state_) {
    const double left_s = longest_s - since_s(start_ns);
    if (left_s <= 0) return false;
    socket_.wait(left_s);  // a signal may end it early
    if (!drain()) return false;
  }
  answers_come_ = true;
  return true;
}

template class UdpLink<AngleDrive>;
template class UdpLink<PoseDrive>;

}  // namespace trocar::runtime
