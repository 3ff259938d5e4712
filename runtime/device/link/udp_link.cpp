// SPDX-License-Identifier: Apache-2.0
#include "runtime/device/link/udp_link.h"

#include <netdb.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <charconv>

#include "formats/base/text.h"
#include "runtime/realtime/realtime_thread.h"

namespace trocar::runtime {

/// What a host observes while it tries to reach a drive. If the attempt fails, it says why.
struct LinkAttempt {
  LinkNonce nonce{};  ///< nonce of the host's hello, the first packet of the handshake
  // Each flag says whether one kind of answer has arrived.
  //  - welcomed: the drive accepted the hello.
  //  - wrong_key: the drive denied the hello, because it has another key.
  //  - busy: the drive denied the hello, because it serves another host.
  //  - other_kind: the drive denied the hello. The host wanted angles and the drive has poses, or
  //    the host wanted poses and the drive has angles.
  //  - other_program: the answer does not come from a drive of the device link.
  //  - other_version: the answer is of another version of the protocol.
  bool welcomed = false, wrong_key = false, busy = false, other_kind = false;
  bool other_program = false, other_version = false;
  /// The reason for which the host refused the last packet after the welcome. kNone: the host
  /// accepted this packet, or no packet arrived after the welcome.
  LinkRefusal state_refusal = LinkRefusal::kNone;
  FaultDetail refused;  ///< if state_refusal is kContents: the field that was refused
};

namespace {

sockaddr_in to_system(const Endpoint& endpoint) noexcept {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(endpoint.port);
  address.sin_addr.s_addr = htonl(endpoint.address);
  return address;
}

Endpoint from_system(const sockaddr_in& address) noexcept {
  return {ntohl(address.sin_addr.s_addr), ntohs(address.sin_port)};
}

int make_socket() noexcept {
  return ::socket(AF_INET, SOCK_DGRAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
}

/// The likely mistake of a drive whose states are refused for this reason.
std::string wrong_states(LinkRefusal refusal, const FaultDetail& refused, bool pose) {
  switch (refusal) {
    case LinkRefusal::kContents:
      return measured(refused) +
             (pose ? "; positions are in m, and the quaternion is a unit" : "; angles are in rad");
    case LinkRefusal::kMac:
      return "they must have a MAC with the key of the session, not with the shared one";
    case LinkRefusal::kSession:
      return "they do not have the number of this session";
    case LinkRefusal::kSequence:
      return "their number does not rise from 1";
    case LinkRefusal::kSize:
      return "their size, or the size that they state, is wrong";
    default:  // magic and kind
      return "they do not begin like a state";
  }
}

/// Sets the flags for a datagram other than a welcome. (The caller itself evaluates a welcome and
/// sets `welcomed`.)
void note_answer(std::span<const std::uint8_t> datagram, LinkAttempt& attempt) noexcept {
  constexpr std::size_t kVersionAt = 4;  // the version follows the magic
  DenialPacket denial;
  if (decode(datagram, attempt.nonce, denial) == LinkRefusal::kNone) {
    attempt.wrong_key = attempt.wrong_key || denial.reason == DenialReason::kKey;
    attempt.busy = attempt.busy || denial.reason == DenialReason::kBusy;
    attempt.other_kind = attempt.other_kind || denial.reason == DenialReason::kKind;
    return;
  }
  LinkNonce ignored;
  const bool is_link = datagram.size() > kVersionAt &&
                       std::equal(kLinkMagic.begin(), kLinkMagic.end(), datagram.begin());
  attempt.other_version =
      attempt.other_version || (is_link && datagram[kVersionAt] != kLinkVersion);
  // A program that echoes datagrams sends back the hello.
  attempt.other_program = attempt.other_program || !is_link || hello_nonce(datagram, ignored);
}

/// Returns the reason why the attempt failed. `socket_error`: UdpSocket::error(). `wanted`: what
/// the hello requested, angles or poses.
std::string why_unreachable(const LinkAttempt& attempt, int socket_error, LinkContents wanted) {
  const bool pose = wanted == LinkContents::kPose;
  if (attempt.welcomed && attempt.state_refusal != LinkRefusal::kNone) {
    return std::string("the device's states are refused (") + to_string(attempt.state_refusal) +
           "): " + wrong_states(attempt.state_refusal, attempt.refused, pose) +
           "; compare with device_link.md";
  }
  // This also happens if another host's session began between the welcome and the first command.
  if (attempt.welcomed) {
    return "the device answered but sends no states; end another host's session with it, or "
           "restart it";
  }
  if (attempt.wrong_key) {
    return "the device there has another key; --key-file must be a copy of the file that it was "
           "started with";
  }
  if (attempt.other_kind) {
    return std::string("the device there is of another kind: it states ") +
           (pose ? "angles; use --device udp:" : "poses; use --device pose:");
  }
  if (attempt.busy) return "the device there is in a session with another host; end that one first";
  if (attempt.other_version) return "the device there speaks another version of the device link";
  if (attempt.other_program)
    return "another program answers there, not a device; check the address and the port";
  if (socket_error == ECONNREFUSED) {
    return "no device answers there: nothing listens on this port; start the device, or check "
           "the port";
  }
  if (socket_error != 0) return "no device answers there: " + system_message(socket_error);
  return std::string(
             "no device answers there: the host is off or cannot be reached (address, "
             "cable, firewall), or its device has another key and does not answer") +
         (pose ? " or states angles (--device udp:)" : "");
}

constexpr double kHelloPeriod_s = 0.05;
constexpr auto kRequestPoll = std::chrono::milliseconds(5);

double since_s(std::int64_t then_ns) noexcept {
  return static_cast<double>(monotonic_ns() - then_ns) * 1e-9;
}

}  // namespace

std::string to_string(const Endpoint& endpoint) {
  std::string text;
  for (int shift = 24; shift >= 0; shift -= 8)
    text += std::to_string((endpoint.address >> shift) & 0xff) + (shift > 0 ? "." : ":");
  return text + std::to_string(endpoint.port);
}

Result<Endpoint> parse_endpoint(std::string_view text, int lowest_port) {
  const std::size_t colon = text.rfind(':');
  std::string quoted = "\"";
  quoted.append(text.substr(0, 256)).append("\"");
  if (colon == std::string_view::npos || colon == 0)
    return usage(quoted + ": must be HOST:PORT, for instance 127.0.0.1:4840");
  const std::string_view digits = text.substr(colon + 1);
  int port = -1;
  const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), port);
  if (error != std::errc{} || end != digits.data() + digits.size() || port < lowest_port ||
      port > 65535) {
    return usage(quoted + ": the port must be within " + std::to_string(lowest_port) +
                 " and 65535");
  }
  addrinfo hints{};
  hints.ai_family = AF_INET;
  hints.ai_socktype = SOCK_DGRAM;
  addrinfo* found = nullptr;
  // This name means this computer (RFC 6761), also where no /etc/hosts says so.
  const std::string name(text.substr(0, colon)), host = name == "localhost" ? "127.0.0.1" : name;
  if (const int failed = ::getaddrinfo(host.c_str(), nullptr, &hints, &found); failed != 0) {
    return usage(quoted + ": the name \"" + host.substr(0, 256) + "\" gives no address (" +
                 ::gai_strerror(failed) + "); check it, or give the address in digits");
  }
  Endpoint endpoint = from_system(*reinterpret_cast<const sockaddr_in*>(found->ai_addr));
  ::freeaddrinfo(found);
  endpoint.port = static_cast<std::uint16_t>(port);
  return endpoint;
}

Result<UdpSocket> UdpSocket::listen(const Endpoint& local) {
  UdpSocket made(make_socket());
  const sockaddr_in address = to_system(local);
  if (made.fd_.get() < 0 ||
      ::bind(made.fd_.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0) {
    return unwritable(to_string(local) + ": cannot listen: " + system_message(errno));
  }
  return made;
}

Result<UdpSocket> UdpSocket::connect(const Endpoint& peer) {
  UdpSocket made(make_socket());
  const sockaddr_in address = to_system(peer);
  if (made.fd_.get() < 0 ||
      ::connect(made.fd_.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0) {
    return Error{ExitCode::kDeviceFault, to_string(peer) + ": " + system_message(errno)};
  }
  return made;
}

UdpSocket::Outcome UdpSocket::outcome_of(std::int64_t done) noexcept {
  if (done >= 0) return Outcome::kDone;
  switch (errno) {
    case EAGAIN:
    case EINTR:
    case ENOBUFS:
      return Outcome::kNothing;
    default:
      error_ = errno;
      return Outcome::kGone;
  }
}

UdpSocket::Outcome UdpSocket::receive(std::span<std::uint8_t> buffer, std::size_t& bytes,
                                      Endpoint& from) noexcept {
  sockaddr_in address{};
  socklen_t length = sizeof address;
  const ssize_t got = ::recvfrom(fd_.get(), buffer.data(), buffer.size(), MSG_TRUNC,
                                 reinterpret_cast<sockaddr*>(&address), &length);
  if (got >= 0) {
    bytes = static_cast<std::size_t>(got);
    from = from_system(address);
  }
  return outcome_of(got);
}

UdpSocket::Outcome UdpSocket::send(std::span<const std::uint8_t> datagram) noexcept {
  return outcome_of(::send(fd_.get(), datagram.data(), datagram.size(), MSG_NOSIGNAL));
}

UdpSocket::Outcome UdpSocket::send_to(std::span<const std::uint8_t> datagram,
                                      const Endpoint& to) noexcept {
  const sockaddr_in address = to_system(to);
  return outcome_of(::sendto(fd_.get(), datagram.data(), datagram.size(), MSG_NOSIGNAL,
                             reinterpret_cast<const sockaddr*>(&address), sizeof address));
}

bool UdpSocket::wait(double seconds) noexcept {
  pollfd waited{fd_.get(), POLLIN, 0};
  const double ms = std::ceil(std::clamp(seconds, 0.0, 3600.0) * 1e3);
  return ::poll(&waited, 1, static_cast<int>(ms)) > 0;
}

Endpoint UdpSocket::local() const noexcept {
  sockaddr_in address{};
  socklen_t length = sizeof address;
  ::getsockname(fd_.get(), reinterpret_cast<sockaddr*>(&address), &length);
  return from_system(address);
}

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
  if (options_.clock == LinkClock::kReal)
    restorer_ = std::thread([this] { restore_when_requested(); });
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
  HelloPacket hello{.host_nonce = random_nonce(),
                    .period_s = options_.period_s,
                    .resets_world = resets_world,
                    .contents = Kind::kContents};
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
                 to_string(options_.peer) + ": " +
                     why_unreachable(attempt, socket_.error(), Kind::kContents)};
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
        note_answer(datagram, attempt);
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
