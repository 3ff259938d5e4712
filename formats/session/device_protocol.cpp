// SPDX-License-Identifier: Apache-2.0
#include "formats/session/device_protocol.h"

#include <sodium.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <concepts>
#include <cstring>
#include <string_view>
#include <type_traits>

namespace trocar {
namespace {

static_assert(kLinkKeyBytes == crypto_generichash_KEYBYTES);
static_assert(kLinkMacBytes == crypto_generichash_BYTES);

using Bytes = std::span<const std::uint8_t>;

constexpr std::size_t kHeaderBytes = 32;

/// Writes fields consecutively. The caller has checked the size.
class Writer {
 public:
  explicit Writer(std::uint8_t* at) : at_(at) {}
  void u64(std::uint64_t value) noexcept { put(value, 8); }
  void u16(std::uint16_t value) noexcept { put(value, 2); }
  void u8(std::uint8_t value) noexcept { put(value, 1); }
  void f64(double value) noexcept { u64(std::bit_cast<std::uint64_t>(value)); }
  void bytes(Bytes values) noexcept { at_ = std::copy(values.begin(), values.end(), at_); }
  void zeros(std::size_t count) noexcept { at_ = std::fill_n(at_, count, std::uint8_t{0}); }
  template <typename Number>
  void field(Number value) noexcept {
    put(static_cast<std::uint64_t>(value), sizeof value);
  }
  template <std::size_t N>
  void field(const std::array<double, N>& values) noexcept {
    for (const double value : values)
      f64(value);
  }

 private:
  void put(std::uint64_t value, int count) noexcept {
    for (int i = 0; i < count; ++i)
      *at_++ = static_cast<std::uint8_t>(value >> (8 * i));
  }
  std::uint8_t* at_;
};

class Reader {
 public:
  explicit Reader(const std::uint8_t* at) : at_(at) {}
  std::uint64_t u64() noexcept { return get(8); }
  std::uint16_t u16() noexcept { return static_cast<std::uint16_t>(get(2)); }
  std::uint8_t u8() noexcept { return static_cast<std::uint8_t>(get(1)); }
  double f64() noexcept { return std::bit_cast<double>(u64()); }
  template <std::size_t N>
  void bytes(std::array<std::uint8_t, N>& out) noexcept {
    std::copy_n(at_, N, out.begin());
    at_ += N;
  }
  bool zeros(std::size_t count) noexcept {
    const bool good = std::all_of(at_, at_ + count, [](std::uint8_t b) { return b == 0; });
    at_ += count;
    all_zeros_ = all_zeros_ && good;
    return good;
  }
  /// True if every zeros() found zeros.
  bool all_zeros() const noexcept { return all_zeros_; }
  template <typename Number>
  void field(Number& value) noexcept {
    value = static_cast<Number>(get(sizeof value));
  }
  template <std::size_t N>
  void field(std::array<double, N>& values) noexcept {
    for (double& value : values)
      value = f64();
  }

 private:
  std::uint64_t get(int count) noexcept {
    std::uint64_t value = 0;
    for (int i = 0; i < count; ++i)
      value |= std::uint64_t{*at_++} << (8 * i);
    return value;
  }
  const std::uint8_t* at_;
  bool all_zeros_ = true;
};

/// Kind and size of each packet.
template <PacketKind kind, std::size_t bytes>
struct FormatOf {
  static constexpr PacketKind kKind = kind;
  static constexpr std::size_t kBytes = bytes;
};
template <typename Packet>
struct Format;
template <>
struct Format<HelloPacket> : FormatOf<PacketKind::kHello, kHelloBytes> {};
template <>
struct Format<WelcomePacket> : FormatOf<PacketKind::kWelcome, kWelcomeBytes> {};
template <>
struct Format<CommandPacket> : FormatOf<PacketKind::kCommand, kCommandBytes> {};
template <>
struct Format<StatePacket> : FormatOf<PacketKind::kState, kStateBytes> {};
template <>
struct Format<DenialPacket> : FormatOf<PacketKind::kDenial, kDenialBytes> {};
template <>
struct Format<WrenchCommandPacket> : FormatOf<PacketKind::kWrenchCommand, kWrenchCommandBytes> {};
template <>
struct Format<PoseStatePacket> : FormatOf<PacketKind::kPoseState, kPoseStateBytes> {};

struct Header {
  std::uint64_t session = 0, sequence = 0;
  std::int64_t time_ns = 0;
};

void mac_of(Bytes bytes, const LinkKey& key, std::uint8_t* out) noexcept {
  crypto_generichash(out, kLinkMacBytes, bytes.data(), bytes.size(), key.bytes.data(),
                     key.bytes.size());
}

template <typename Packet>
Writer write_header(const Header& header, std::uint8_t* out) noexcept {
  Writer writer(out);
  writer.bytes(kLinkMagic);
  writer.u8(kLinkVersion);
  writer.u8(static_cast<std::uint8_t>(Format<Packet>::kKind));
  writer.u16(static_cast<std::uint16_t>(Format<Packet>::kBytes));
  writer.u64(header.session);
  writer.u64(header.sequence);
  writer.u64(static_cast<std::uint64_t>(header.time_ns));
  return writer;
}

template <typename Packet>
std::size_t seal(const LinkKey& key, std::uint8_t* out) noexcept {
  constexpr std::size_t kBytes = Format<Packet>::kBytes;
  mac_of({out, kBytes - kLinkMacBytes}, key, out + kBytes - kLinkMacBytes);
  return kBytes;
}

/// Checks size, magic, version and kind.
template <typename Packet>
LinkRefusal open_header(Bytes bytes, Header& header) noexcept {
  if (bytes.size() < kHeaderBytes || bytes.size() > kMaxPacketBytes) return LinkRefusal::kSize;
  if (!std::equal(kLinkMagic.begin(), kLinkMagic.end(), bytes.begin()) ||
      bytes[4] != kLinkVersion) {
    return LinkRefusal::kMagic;
  }
  if (bytes[5] != static_cast<std::uint8_t>(Format<Packet>::kKind)) return LinkRefusal::kKind;
  Reader reader(bytes.data() + 6);
  if (reader.u16() != bytes.size() || bytes.size() != Format<Packet>::kBytes) {
    return LinkRefusal::kSize;
  }
  header.session = reader.u64();
  header.sequence = reader.u64();
  header.time_ns = static_cast<std::int64_t>(reader.u64());
  return LinkRefusal::kNone;
}

/// Checks everything except the contents. Set `any_session` for hello and welcome, which belong to no
/// known session.
template <typename Packet>
LinkRefusal open(Bytes bytes, const LinkKey& key, bool any_session, std::uint64_t session,
                 Header& header) noexcept {
  constexpr std::size_t kBytes = Format<Packet>::kBytes;
  const LinkRefusal refusal = open_header<Packet>(bytes, header);
  if (refusal != LinkRefusal::kNone) return refusal;
  if (!any_session && header.session != session) return LinkRefusal::kSession;
  std::array<std::uint8_t, kLinkMacBytes> mac;
  mac_of(bytes.first(kBytes - kLinkMacBytes), key, mac.data());
  // This takes constant time, so that the time does not reveal how much of a guess is right.
  return sodium_memcmp(mac.data(), bytes.data() + kBytes - kLinkMacBytes, kLinkMacBytes) == 0
             ? LinkRefusal::kNone
             : LinkRefusal::kMac;
}

bool good_period(double period_s) noexcept {
  return period_s >= kLinkMinPeriod_s && period_s <= kLinkMaxPeriod_s;  // false for nan
}

template <std::size_t N>
bool all_within(const std::array<double, N>& values, double largest) noexcept {
  return std::all_of(values.begin(), values.end(),
                     [&](double value) { return std::abs(value) <= largest; });  // nan: false
}

bool good_contents(const HelloPacket& packet) noexcept {
  return good_period(packet.period_s) && packet.contents <= LinkContents::kPose;
}
bool good_contents(const WelcomePacket& packet) noexcept {
  return good_period(packet.period_s) &&
         (packet.clock == LinkClock::kReal || packet.clock == LinkClock::kLockStep);
}
bool good_contents(const CommandPacket& packet) noexcept {
  const bool no_torque = packet.mode == CommandMode::kFree || packet.mode == CommandMode::kStop;
  return packet.sequence > 0 && (no_torque || packet.mode == CommandMode::kTorque) &&
         all_within(packet.tau_motor_Nm, no_torque ? 0 : kLinkMaxTorque_Nm);
}
bool good_contents(const StatePacket& packet) noexcept {
  return packet.sequence > 0 && packet.mode >= DriveMode::kReady &&
         packet.mode <= DriveMode::kEmergencyStop &&
         all_within(packet.encoder_rad, kLinkMaxAngle_rad);
}

bool good_contents(const WrenchCommandPacket& packet) noexcept {
  const bool no_wrench = packet.mode == CommandMode::kFree || packet.mode == CommandMode::kStop;
  return packet.sequence > 0 && (no_wrench || packet.mode == CommandMode::kTorque) &&
         all_within(packet.force_N, no_wrench ? 0 : kLinkMaxForce_N) &&
         all_within(packet.moment_Nm, no_wrench ? 0 : kLinkMaxMoment_Nm);
}
bool good_contents(const PoseStatePacket& packet) noexcept {
  double norm2 = 0;
  for (const double each : packet.q)
    norm2 += each * each;
  return packet.sequence > 0 && packet.mode >= DriveMode::kReady &&
         packet.mode <= DriveMode::kEmergencyStop && all_within(packet.p_m, kLinkMaxPosition_m) &&
         std::abs(std::sqrt(norm2) - 1) <= kLinkQuaternionTolerance;  // nan: false
}

// The contents of commands and states. `io` is a Writer and the packet const, or a Reader.
template <typename T, typename Packet>
concept MaybeConst = std::same_as<std::remove_const_t<T>, Packet>;

void contents(auto& io, MaybeConst<CommandPacket> auto& packet) noexcept {
  io.field(packet.mode);
  io.zeros(7);
  io.field(packet.state_seen);
  io.field(packet.tau_motor_Nm);
}
void contents(auto& io, MaybeConst<StatePacket> auto& packet) noexcept {
  io.field(packet.mode);
  io.field(packet.motor_faults);
  io.zeros(6);
  io.field(packet.command_taken);
  io.field(packet.encoder_rad);
}
void contents(auto& io, MaybeConst<WrenchCommandPacket> auto& packet) noexcept {
  io.field(packet.mode);
  io.zeros(7);
  io.field(packet.state_seen);
  io.field(packet.force_N);
  io.field(packet.moment_Nm);
}
void contents(auto& io, MaybeConst<PoseStatePacket> auto& packet) noexcept {
  io.field(packet.mode);
  io.field(packet.faults);
  io.zeros(2);
  io.field(packet.buttons);
  io.field(packet.command_taken);
  io.field(packet.p_m);
  io.field(packet.q);
}

/// Encodes a packet of a session.
template <typename Packet>
std::size_t encode_numbered(const Packet& packet, const LinkKey& key,
                            std::span<std::uint8_t> out) noexcept {
  if (out.size() < Format<Packet>::kBytes || !good_contents(packet)) return 0;
  Writer writer =
      write_header<Packet>({packet.session, packet.sequence, packet.time_ns}, out.data());
  contents(writer, packet);
  return seal<Packet>(key, out.data());
}

/// Decodes a packet of a session.
template <typename Packet>
LinkRefusal decode_numbered(Bytes bytes, const LinkKey& key, std::uint64_t session,
                            std::uint64_t& last_sequence, Packet& packet) noexcept {
  Header header;
  const LinkRefusal refusal = open<Packet>(bytes, key, false, session, header);
  if (refusal != LinkRefusal::kNone) return refusal;
  Packet read;
  read.session = header.session;
  read.sequence = header.sequence;
  read.time_ns = header.time_ns;
  Reader reader(bytes.data() + kHeaderBytes);
  contents(reader, read);
  if (read.sequence <= last_sequence) return LinkRefusal::kSequence;
  if (!reader.all_zeros() || !good_contents(read)) return LinkRefusal::kContents;
  last_sequence = read.sequence;
  packet = read;
  return LinkRefusal::kNone;
}

}  // namespace

const char* to_string(LinkRefusal refusal) noexcept {
  static constexpr std::array<const char*, kLinkRefusals> kNames = {
      "accepted", "size", "magic", "kind", "session", "mac", "sequence", "contents"};
  const auto at = static_cast<std::size_t>(refusal);
  return at < kNames.size() ? kNames[at] : "unknown";
}

std::uint64_t LinkCounts::refused() const noexcept {
  std::uint64_t sum = 0;
  for (std::size_t i = 1; i < by_refusal.size(); ++i)
    sum += by_refusal[i];
  return sum;
}

Result<void> start_link() {
  if (::sodium_init() < 0) return bug("libsodium cannot be initialised");
  return {};
}

LinkKey random_link_key() noexcept {
  LinkKey key;
  ::randombytes_buf(key.bytes.data(), key.bytes.size());
  return key;
}

LinkNonce random_nonce() noexcept {
  LinkNonce nonce;
  ::randombytes_buf(nonce.data(), nonce.size());
  return nonce;
}

LinkKey session_key(const LinkKey& shared, const LinkNonce& host, const LinkNonce& drive) noexcept {
  constexpr std::string_view kPurpose = "trocar link 1";
  std::array<std::uint8_t, kPurpose.size() + 2 * kLinkNonceBytes> text;
  auto at = std::copy(kPurpose.begin(), kPurpose.end(), text.begin());
  at = std::copy(host.begin(), host.end(), at);
  std::copy(drive.begin(), drive.end(), at);
  LinkKey key;
  mac_of(text, shared, key.bytes.data());
  return key;
}

std::uint64_t session_number(const LinkNonce& drive) noexcept {
  return Reader(drive.data()).u64();
}

std::size_t encode(const HelloPacket& packet, const LinkKey& key,
                   std::span<std::uint8_t> out) noexcept {
  if (out.size() < kHelloBytes || !good_contents(packet)) return 0;
  Writer writer = write_header<HelloPacket>({0, 1, packet.time_ns}, out.data());
  writer.bytes(packet.host_nonce);
  writer.f64(packet.period_s);
  writer.u8(packet.resets_world ? 1 : 0);
  writer.field(packet.contents);
  writer.zeros(6);
  return seal<HelloPacket>(key, out.data());
}

std::size_t encode(const WelcomePacket& packet, const LinkKey& key,
                   std::span<std::uint8_t> out) noexcept {
  if (out.size() < kWelcomeBytes || !good_contents(packet)) return 0;
  Writer writer = write_header<WelcomePacket>(
      {session_number(packet.drive_nonce), 1, packet.time_ns}, out.data());
  writer.bytes(packet.host_nonce);
  writer.bytes(packet.drive_nonce);
  writer.f64(packet.period_s);
  writer.u8(static_cast<std::uint8_t>(packet.clock));
  writer.zeros(7);
  return seal<WelcomePacket>(key, out.data());
}

std::size_t encode(const CommandPacket& packet, const LinkKey& key,
                   std::span<std::uint8_t> out) noexcept {
  return encode_numbered(packet, key, out);
}
std::size_t encode(const StatePacket& packet, const LinkKey& key,
                   std::span<std::uint8_t> out) noexcept {
  return encode_numbered(packet, key, out);
}
std::size_t encode(const WrenchCommandPacket& packet, const LinkKey& key,
                   std::span<std::uint8_t> out) noexcept {
  return encode_numbered(packet, key, out);
}
std::size_t encode(const PoseStatePacket& packet, const LinkKey& key,
                   std::span<std::uint8_t> out) noexcept {
  return encode_numbered(packet, key, out);
}

std::size_t encode(const DenialPacket& packet, std::span<std::uint8_t> out) noexcept {
  if (out.size() < kDenialBytes) return 0;
  Writer writer = write_header<DenialPacket>({0, 1, packet.time_ns}, out.data());
  writer.bytes(packet.host_nonce);
  writer.u8(static_cast<std::uint8_t>(packet.reason));
  writer.zeros(7);
  return kDenialBytes;
}

bool hello_nonce(Bytes bytes, LinkNonce& nonce) noexcept {
  Header header;
  if (open_header<HelloPacket>(bytes, header) != LinkRefusal::kNone) return false;
  Reader(bytes.data() + kHeaderBytes).bytes(nonce);
  return true;
}

PacketKind claimed_kind(Bytes bytes) noexcept {
  if (bytes.size() == kDenialBytes && bytes[5] == 5) return PacketKind::kDenial;
  if (bytes.size() == kWelcomeBytes && bytes[5] == 2) return PacketKind::kWelcome;
  if (bytes.size() == kCommandBytes && bytes[5] == 3) return PacketKind::kCommand;
  if (bytes.size() == kStateBytes && bytes[5] == 4) return PacketKind::kState;
  if (bytes.size() == kWrenchCommandBytes && bytes[5] == 6) return PacketKind::kWrenchCommand;
  if (bytes.size() == kPoseStateBytes && bytes[5] == 7) return PacketKind::kPoseState;
  return PacketKind::kHello;
}

LinkRefusal decode(Bytes bytes, const LinkKey& key, HelloPacket& packet) noexcept {
  Header header;
  const LinkRefusal refusal = open<HelloPacket>(bytes, key, true, 0, header);
  if (refusal != LinkRefusal::kNone) return refusal;
  HelloPacket read;
  read.time_ns = header.time_ns;
  Reader reader(bytes.data() + kHeaderBytes);
  reader.bytes(read.host_nonce);
  read.period_s = reader.f64();
  const std::uint8_t resets_world = reader.u8();
  read.resets_world = resets_world == 1;
  reader.field(read.contents);
  if (resets_world > 1 || !reader.zeros(6) || header.session != 0 || header.sequence != 1 ||
      !good_contents(read)) {
    return LinkRefusal::kContents;
  }
  packet = read;
  return LinkRefusal::kNone;
}

LinkRefusal decode(Bytes bytes, const LinkKey& key, const LinkNonce& asked,
                   WelcomePacket& packet) noexcept {
  Header header;
  const LinkRefusal refusal = open<WelcomePacket>(bytes, key, true, 0, header);
  if (refusal != LinkRefusal::kNone) return refusal;
  WelcomePacket read;
  read.time_ns = header.time_ns;
  Reader reader(bytes.data() + kHeaderBytes);
  reader.bytes(read.host_nonce);
  reader.bytes(read.drive_nonce);
  read.period_s = reader.f64();
  read.clock = static_cast<LinkClock>(reader.u8());
  if (!reader.zeros(7) || header.sequence != 1 ||
      header.session != session_number(read.drive_nonce) || read.host_nonce != asked ||
      !good_contents(read)) {
    return LinkRefusal::kContents;
  }
  packet = read;
  return LinkRefusal::kNone;
}

LinkRefusal decode(Bytes bytes, const LinkNonce& asked, DenialPacket& packet) noexcept {
  Header header;
  const LinkRefusal refusal = open_header<DenialPacket>(bytes, header);
  if (refusal != LinkRefusal::kNone) return refusal;
  DenialPacket read;
  read.time_ns = header.time_ns;
  Reader reader(bytes.data() + kHeaderBytes);
  reader.bytes(read.host_nonce);
  read.reason = static_cast<DenialReason>(reader.u8());
  const bool known = read.reason >= DenialReason::kKey && read.reason <= DenialReason::kKind;
  if (!known || !reader.zeros(7) || header.session != 0 || header.sequence != 1 ||
      read.host_nonce != asked) {
    return LinkRefusal::kContents;
  }
  packet = read;
  return LinkRefusal::kNone;
}

LinkRefusal decode(Bytes bytes, const LinkKey& key, std::uint64_t session,
                   std::uint64_t& last_sequence, CommandPacket& packet) noexcept {
  return decode_numbered(bytes, key, session, last_sequence, packet);
}
LinkRefusal decode(Bytes bytes, const LinkKey& key, std::uint64_t session,
                   std::uint64_t& last_sequence, StatePacket& packet) noexcept {
  return decode_numbered(bytes, key, session, last_sequence, packet);
}
LinkRefusal decode(Bytes bytes, const LinkKey& key, std::uint64_t session,
                   std::uint64_t& last_sequence, WrenchCommandPacket& packet) noexcept {
  return decode_numbered(bytes, key, session, last_sequence, packet);
}
LinkRefusal decode(Bytes bytes, const LinkKey& key, std::uint64_t session,
                   std::uint64_t& last_sequence, PoseStatePacket& packet) noexcept {
  return decode_numbered(bytes, key, session, last_sequence, packet);
}

}  // namespace trocar
