// SPDX-License-Identifier: Apache-2.0
#include "formats/session/device_protocol.h"

#include <sodium.h>
#include <algorithm>
#include <bit>
#include <cmath>
#include <concepts>
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
  void zeros(std::size_t count) noexcept { at_ = std::fill_n(at_, count, std::uint8_t{0}); }
  template <typename Number>
  void field(Number value) noexcept {
    put(static_cast<std::uint64_t>(value), sizeof value);
  }
  void field(double value) noexcept { put(std::bit_cast<std::uint64_t>(value), sizeof value); }
  template <typename Element, std::size_t N>
  void field(const std::array<Element, N>& values) noexcept {
    for (const Element value : values)
      field(value);
  }
  void fields(const auto&... values) noexcept { (field(values), ...); }

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
  void zeros(std::size_t count) noexcept {
    is_well_formed_ = is_well_formed_ &&
                      std::all_of(at_, at_ + count, [](std::uint8_t byte) { return byte == 0; });
    at_ += count;
  }
  /// True if every zeros() found zeros, and every truth value was 0 or 1.
  bool is_well_formed() const noexcept { return is_well_formed_; }
  template <typename Number>
  void field(Number& value) noexcept {
    value = static_cast<Number>(get(sizeof value));
  }
  void field(double& value) noexcept { value = std::bit_cast<double>(get(sizeof value)); }
  void field(bool& value) noexcept {
    const std::uint64_t byte = get(1);
    is_well_formed_ = is_well_formed_ && byte <= 1;
    value = byte == 1;
  }
  template <typename Element, std::size_t N>
  void field(std::array<Element, N>& values) noexcept {
    for (Element& value : values)
      field(value);
  }
  void fields(auto&... values) noexcept { (field(values), ...); }

 private:
  std::uint64_t get(int count) noexcept {
    std::uint64_t value = 0;
    for (int i = 0; i < count; ++i)
      value |= std::uint64_t{*at_++} << (8 * i);
    return value;
  }
  const std::uint8_t* at_;
  bool is_well_formed_ = true;
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
  friend bool operator==(const Header&, const Header&) = default;
};

/// Hello and denial belong to no session. The session of a welcome follows from the drive's nonce.
template <typename Packet>
Header header_of(const Packet& packet) noexcept {
  if constexpr (requires { packet.session; }) {
    return {packet.session, packet.sequence, packet.time_ns};
  } else if constexpr (requires { packet.drive_nonce; }) {
    return {session_number(packet.drive_nonce), 1, packet.time_ns};
  } else {
    return {0, 1, packet.time_ns};
  }
}

void mac_of(Bytes bytes, const LinkKey& key, std::uint8_t* out) noexcept {
  crypto_generichash(out, kLinkMacBytes, bytes.data(), bytes.size(), key.bytes.data(),
                     key.bytes.size());
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
  std::uint16_t size = 0;
  reader.field(size);
  if (size != bytes.size() || size != Format<Packet>::kBytes) return LinkRefusal::kSize;
  reader.fields(header.session, header.sequence, header.time_ns);
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
bool good_contents(const DenialPacket& packet) noexcept {
  return packet.reason >= DenialReason::kKey && packet.reason <= DenialReason::kKind;
}
bool good_contents(const CommandPacket& packet) noexcept {
  const bool no_torque = packet.mode == CommandMode::kFree || packet.mode == CommandMode::kStop;
  return packet.sequence > 0 && (no_torque || packet.mode == CommandMode::kTorque) &&
         all_within(packet.tau_motor_Nm, no_torque ? 0 : kLinkMaxTorque_Nm);
}
FaultDetail refused(FaultQuantity field, int index, double value, double limit) noexcept {
  return {Fault::kRefusedState, field, index, value, limit};
}

FaultDetail refused_mode(DriveMode mode) noexcept {
  if (mode >= DriveMode::kReady && mode <= DriveMode::kEmergencyStop) return {};
  return refused(FaultQuantity::kStateMode, -1, static_cast<double>(mode),
                 static_cast<double>(DriveMode::kEmergencyStop));
}

/// Returns the first value that is beyond a limit or nan.
template <std::size_t N>
FaultDetail refused_value(FaultQuantity field, const std::array<double, N>& values,
                          double largest) noexcept {
  for (std::size_t i = 0; i < N; ++i)
    if (!(std::abs(values[i]) <= largest))
      return refused(field, static_cast<int>(i), values[i], std::copysign(largest, values[i]));
  return {};
}

/// Returns the first field that is refused, or no fault.
FaultDetail refused_field(const StatePacket& packet) noexcept {
  if (const FaultDetail mode = refused_mode(packet.mode); mode != Fault::kNone) return mode;
  return refused_value(FaultQuantity::kEncoderAngle, packet.encoder_rad, kLinkMaxAngle_rad);
}
FaultDetail refused_field(const PoseStatePacket& packet) noexcept {
  if (const FaultDetail mode = refused_mode(packet.mode); mode != Fault::kNone) return mode;
  const FaultDetail position =
      refused_value(FaultQuantity::kMeasuredPosition, packet.p_m, kLinkMaxPosition_m);
  if (position != Fault::kNone) return position;
  double norm2 = 0;
  for (const double each : packet.q)
    norm2 += each * each;
  const double norm = std::sqrt(norm2);
  if (std::abs(norm - 1) <= kLinkQuaternionTolerance) return {};  // nan: false
  return refused(FaultQuantity::kMeasuredRotation, -1, norm, 1);
}
FaultDetail refused_field(const auto& /*packet*/) noexcept {
  return {};
}

bool good_contents(const StatePacket& packet) noexcept {
  return packet.sequence > 0 && refused_field(packet) == Fault::kNone;
}
bool good_contents(const WrenchCommandPacket& packet) noexcept {
  const bool no_wrench = packet.mode == CommandMode::kFree || packet.mode == CommandMode::kStop;
  return packet.sequence > 0 && (no_wrench || packet.mode == CommandMode::kTorque) &&
         all_within(packet.force_N, no_wrench ? 0 : kLinkMaxForce_N) &&
         all_within(packet.moment_Nm, no_wrench ? 0 : kLinkMaxMoment_Nm);
}
bool good_contents(const PoseStatePacket& packet) noexcept {
  return packet.sequence > 0 && refused_field(packet) == Fault::kNone;
}

// The contents of packets. `io` is a Writer and the packet const, or a Reader.
template <typename T, typename Packet>
concept MaybeConst = std::same_as<std::remove_const_t<T>, Packet>;

void contents(auto& io, MaybeConst<HelloPacket> auto& packet) noexcept {
  io.fields(packet.host_nonce, packet.period_s, packet.resets_world, packet.contents);
  io.zeros(6);
}
void contents(auto& io, MaybeConst<WelcomePacket> auto& packet) noexcept {
  io.fields(packet.host_nonce, packet.drive_nonce, packet.period_s, packet.clock);
  io.zeros(7);
}
void contents(auto& io, MaybeConst<DenialPacket> auto& packet) noexcept {
  io.fields(packet.host_nonce, packet.reason);
  io.zeros(7);
}
void contents(auto& io, MaybeConst<CommandPacket> auto& packet) noexcept {
  io.field(packet.mode);
  io.zeros(7);
  io.fields(packet.state_seen, packet.tau_motor_Nm);
}
void contents(auto& io, MaybeConst<StatePacket> auto& packet) noexcept {
  io.fields(packet.mode, packet.motor_faults);
  io.zeros(6);
  io.fields(packet.command_taken, packet.encoder_rad);
}
void contents(auto& io, MaybeConst<WrenchCommandPacket> auto& packet) noexcept {
  io.field(packet.mode);
  io.zeros(7);
  io.fields(packet.state_seen, packet.force_N, packet.moment_Nm);
}
void contents(auto& io, MaybeConst<PoseStatePacket> auto& packet) noexcept {
  io.fields(packet.mode, packet.faults);
  io.zeros(2);
  io.fields(packet.buttons, packet.command_taken, packet.p_m, packet.q);
}

/// Writes header and contents, but no MAC. The caller has checked the size of `out`.
template <typename Packet>
void write_packet(const Packet& packet, std::uint8_t* out) noexcept {
  const Header header = header_of(packet);
  Writer writer(out);
  writer.fields(kLinkMagic, kLinkVersion, Format<Packet>::kKind,
                static_cast<std::uint16_t>(Format<Packet>::kBytes), header.session, header.sequence,
                header.time_ns);
  contents(writer, packet);
}

/// Reads the packet whose header open_header() has read. Returns false if header or contents are
/// not those of such a packet.
template <typename Packet>
bool read_packet(Bytes bytes, const Header& header, Packet& packet) noexcept {
  if constexpr (requires { packet.session; }) {
    packet.session = header.session;
    packet.sequence = header.sequence;
  }
  packet.time_ns = header.time_ns;
  Reader reader(bytes.data() + kHeaderBytes);
  contents(reader, packet);
  return reader.is_well_formed() && header == header_of(packet) && good_contents(packet);
}

/// Reads a packet of the handshake. `asked` is the nonce that the packet must have; null: any.
template <typename Packet>
LinkRefusal accept(Bytes bytes, const Header& header, const LinkNonce* asked,
                   Packet& packet) noexcept {
  Packet found;
  if (!read_packet(bytes, header, found) || (asked != nullptr && found.host_nonce != *asked))
    return LinkRefusal::kContents;
  packet = found;
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
  std::uint64_t number = 0;
  Reader(drive.data()).field(number);
  return number;
}

template <typename Packet>
std::size_t encode(const Packet& packet, const LinkKey& key, std::span<std::uint8_t> out) noexcept {
  constexpr std::size_t kBytes = Format<Packet>::kBytes;
  if (out.size() < kBytes || !good_contents(packet)) return 0;
  write_packet(packet, out.data());
  mac_of(out.first(kBytes - kLinkMacBytes), key, out.data() + kBytes - kLinkMacBytes);
  return kBytes;
}
template std::size_t encode(const HelloPacket&, const LinkKey&, std::span<std::uint8_t>) noexcept;
template std::size_t encode(const WelcomePacket&, const LinkKey&, std::span<std::uint8_t>) noexcept;
template std::size_t encode(const CommandPacket&, const LinkKey&, std::span<std::uint8_t>) noexcept;
template std::size_t encode(const StatePacket&, const LinkKey&, std::span<std::uint8_t>) noexcept;
template std::size_t encode(const WrenchCommandPacket&, const LinkKey&,
                            std::span<std::uint8_t>) noexcept;
template std::size_t encode(const PoseStatePacket&, const LinkKey&,
                            std::span<std::uint8_t>) noexcept;

std::size_t encode(const DenialPacket& packet, std::span<std::uint8_t> out) noexcept {
  if (out.size() < kDenialBytes) return 0;
  write_packet(packet, out.data());
  return kDenialBytes;
}

bool hello_nonce(Bytes bytes, LinkNonce& nonce) noexcept {
  Header header;
  if (open_header<HelloPacket>(bytes, header) != LinkRefusal::kNone) return false;
  Reader(bytes.data() + kHeaderBytes).field(nonce);
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
  return accept(bytes, header, nullptr, packet);
}

LinkRefusal decode(Bytes bytes, const LinkKey& key, const LinkNonce& asked,
                   WelcomePacket& packet) noexcept {
  Header header;
  const LinkRefusal refusal = open<WelcomePacket>(bytes, key, true, 0, header);
  if (refusal != LinkRefusal::kNone) return refusal;
  return accept(bytes, header, &asked, packet);
}

LinkRefusal decode(Bytes bytes, const LinkNonce& asked, DenialPacket& packet) noexcept {
  Header header;
  const LinkRefusal refusal = open_header<DenialPacket>(bytes, header);
  if (refusal != LinkRefusal::kNone) return refusal;
  return accept(bytes, header, &asked, packet);
}

template <typename Packet>
LinkRefusal decode(Bytes bytes, const LinkKey& key, std::uint64_t session,
                   std::uint64_t& last_sequence, Packet& packet, FaultDetail& refused) noexcept {
  Header header;
  const LinkRefusal refusal = open<Packet>(bytes, key, false, session, header);
  if (refusal != LinkRefusal::kNone) return refusal;
  Packet found;
  const bool is_good = read_packet(bytes, header, found);
  if (found.sequence <= last_sequence) return LinkRefusal::kSequence;
  if (!is_good) {
    refused = refused_field(found);
    // If every number is good, a byte that must be zero is not.
    if (refused == Fault::kNone)
      refused = {Fault::kRefusedState, FaultQuantity::kStateZeros, -1, 0, 0};
    return LinkRefusal::kContents;
  }
  last_sequence = found.sequence;
  packet = found;
  return LinkRefusal::kNone;
}
template LinkRefusal decode(Bytes, const LinkKey&, std::uint64_t, std::uint64_t&, CommandPacket&,
                            FaultDetail&) noexcept;
template LinkRefusal decode(Bytes, const LinkKey&, std::uint64_t, std::uint64_t&, StatePacket&,
                            FaultDetail&) noexcept;
template LinkRefusal decode(Bytes, const LinkKey&, std::uint64_t, std::uint64_t&,
                            WrenchCommandPacket&, FaultDetail&) noexcept;
template LinkRefusal decode(Bytes, const LinkKey&, std::uint64_t, std::uint64_t&, PoseStatePacket&,
                            FaultDetail&) noexcept;

}  // namespace trocar
