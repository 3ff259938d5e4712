// SPDX-License-Identifier: Apache-2.0
// Packets of the device link, the UDP protocol between the host (the computer with the haptic loop)
// and a drive. Each datagram is one packet of a fixed size. device_link.md specifies the layout to
// the byte and the course of a link session. A link session is one connection between a host and a
// drive: it begins with the host's hello and the drive's welcome; commands of the host and states
// of the drive follow. A drive is of one of two kinds. One kind sends the angles of the four-legged
// device and takes torques (StatePacket, CommandPacket). The other kind sends the pose of a handle
// and takes a wrench (PoseStatePacket, WrenchCommandPacket).
//
// Contract:
//  1. A packet that decode() accepts was made with the key that decode() was given. (Denials are
//     not authenticated.) From the decoded packet, encode() makes the same bytes again.
//  2. A command or state is accepted only once, in its own link session and direction, and never
//     after a newer packet was accepted.
//  3. A refused packet changes nothing.
// No function except start_link() allocates, locks, throws or reads a clock.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "formats/base/result.h"
#include "formats/session/faults.h"

namespace trocar {

inline constexpr std::size_t kLinkKeyBytes = 32, kLinkNonceBytes = 16, kLinkMacBytes = 32;
inline constexpr std::size_t kHelloBytes = 96, kWelcomeBytes = 112, kCommandBytes = 144,
                             kStateBytes = 208, kDenialBytes = 56, kWrenchCommandBytes = 128,
                             kPoseStateBytes = 136;
inline constexpr std::size_t kMaxPacketBytes = kStateBytes;
inline constexpr std::size_t kLinkMotors = 8, kLinkEncoders = 16;
inline constexpr std::array<std::uint8_t, 4> kLinkMagic = {'T', 'R', 'C', 'R'};
inline constexpr std::uint8_t kLinkVersion = 1;
/// Packets with numbers whose magnitude exceeds these limits are refused, because no device needs
/// such numbers.
inline constexpr double kLinkMaxTorque_Nm = 1000, kLinkMaxAngle_rad = 1000;
inline constexpr double kLinkMaxForce_N = 1000, kLinkMaxMoment_Nm = 1000, kLinkMaxPosition_m = 10;
/// The norm of a pose's quaternion may differ from 1 by at most this.
inline constexpr double kLinkQuaternionTolerance = 1e-3;
inline constexpr double kLinkMinPeriod_s = 1e-5, kLinkMaxPeriod_s = 0.1;

struct LinkKey {
  std::array<std::uint8_t, kLinkKeyBytes> bytes{};
};
using LinkNonce = std::array<std::uint8_t, kLinkNonceBytes>;

enum class PacketKind : std::uint8_t {
  kHello = 1,
  kWelcome = 2,
  kCommand = 3,
  kState = 4,
  kDenial = 5,
  kWrenchCommand = 6,
  kPoseState = 7
};

/// The kind of a drive: the packets that the drive sends as states and takes as commands.
enum class LinkContents : std::uint8_t {
  kAngles = 0,  ///< StatePacket and CommandPacket
  kPose = 1,    ///< PoseStatePacket and WrenchCommandPacket
};

enum class LinkClock : std::uint8_t {
  kReal = 1,      ///< time is that of the drive's own clock
  kLockStep = 2,  ///< each torque command advances the drive's time by one period of the host
};
enum class CommandMode : std::uint8_t {
  /// Torques must be zero. With the lock-step clock, the drive answers with a state packet, but
  /// the drive's time does not advance.
  kFree = 1,
  kTorque = 2,  ///< apply these torques, or this wrench, until the next command
  kStop = 3,    ///< torques must be zero; the link session ends
};
enum class DriveMode : std::uint8_t {
  kReady = 1,          ///< torques are zero; a torque command is accepted
  kTorque = 2,         ///< the last command's torques are applied
  kWatchdog = 3,       ///< commands stopped arriving: torques are zero until a command
                       ///< acknowledges this mode. Such a command has zero torques, and its
                       ///< `state_seen` is the number of a state with this mode or of a later state
  kEmergencyStop = 4,  ///< the emergency stop is pressed, or it is released but no command has
                       ///< acknowledged this mode yet: commands have no effect, torques are zero
};

// In all packets, `time_ns` is a time of the sender's clock. In each link session, the sequence
// numbers of commands and those of states begin with 1 and increase strictly.

struct HelloPacket {
  std::int64_t time_ns = 0;
  LinkNonce host_nonce{};
  double period_s = 0;
  /// True: a simulated drive shall restart its simulation from the initial state.
  bool resets_world = true;
  LinkContents contents = LinkContents::kAngles;  ///< the kind of drive that the host expects
  friend bool operator==(const HelloPacket&, const HelloPacket&) = default;
};
struct WelcomePacket {
  std::int64_t time_ns = 0;
  LinkNonce host_nonce{}, drive_nonce{};
  double period_s = 0;
  LinkClock clock = LinkClock::kReal;
  friend bool operator==(const WelcomePacket&, const WelcomePacket&) = default;
};
struct CommandPacket {
  std::uint64_t session = 0, sequence = 0;
  std::int64_t time_ns = 0;
  CommandMode mode = CommandMode::kFree;
  std::uint64_t state_seen = 0;  ///< sequence number of the newest accepted state packet
  std::array<double, kLinkMotors> tau_motor_Nm{};  ///< leg by leg: th1, th4 of leg 1, ...
  friend bool operator==(const CommandPacket&, const CommandPacket&) = default;
};
struct StatePacket {
  std::uint64_t session = 0, sequence = 0;
  std::int64_t time_ns = 0;
  DriveMode mode = DriveMode::kReady;
  /// Bit i is set if motor i's current did not follow its command at some time in this session.
  std::uint8_t motor_faults = 0;
  std::uint64_t command_taken = 0;  ///< sequence number of the newest accepted command
  std::array<double, kLinkEncoders> encoder_rad{};  ///< leg by leg: th1..th4 of leg 1, ...
  friend bool operator==(const StatePacket&, const StatePacket&) = default;
};

struct WrenchCommandPacket {
  std::uint64_t session = 0, sequence = 0;
  std::int64_t time_ns = 0;
  CommandMode mode = CommandMode::kFree;
  std::uint64_t state_seen = 0;  ///< same meaning as CommandPacket::state_seen
  /// The force on the hand, which acts at the point PoseStatePacket::p_m of the handle, and the
  /// moment about this point, in the device's frame.
  std::array<double, 3> force_N{}, moment_Nm{};
  friend bool operator==(const WrenchCommandPacket&, const WrenchCommandPacket&) = default;
};
struct PoseStatePacket {
  std::uint64_t session = 0, sequence = 0;
  std::int64_t time_ns = 0;
  DriveMode mode = DriveMode::kReady;
  /// Not 0: the device has reported a fault in this session. The device's maker defines the bits.
  std::uint8_t faults = 0;
  std::uint32_t buttons = 0;        ///< bit i: button i is pressed
  std::uint64_t command_taken = 0;  ///< same meaning as StatePacket::command_taken
  std::array<double, 3> p_m{};      ///< position of one point of the handle, in the device's frame
  /// Quaternion w x y z that maps coordinates in the handle's frame to the device's frame.
  std::array<double, 4> q{1, 0, 0, 0};
  friend bool operator==(const PoseStatePacket&, const PoseStatePacket&) = default;
};

enum class DenialReason : std::uint8_t {
  kKey = 1,   ///< the hello was not made with the drive's key
  kBusy = 2,  ///< a link session with another host is alive
  kKind = 3,  ///< the drive is not of the kind that the hello names
};
/// The answer to a hello that gets no welcome, with the reason. A denial is not authenticated,
/// because the host may lack the key. So a denial is only a hint for the operator: no decision may
/// depend on a denial.
struct DenialPacket {
  std::int64_t time_ns = 0;
  LinkNonce host_nonce{};  ///< the nonce in the hello
  DenialReason reason = DenialReason::kKey;
  friend bool operator==(const DenialPacket&, const DenialPacket&) = default;
};

/// The reason why a packet was refused: the first check that fails. The checks are made in this
/// order. The size is checked twice: first against the bounds of all packets, and again after kKind
/// against the size of the expected kind.
enum class LinkRefusal : std::uint8_t {
  kNone,      ///< accepted
  kSize,      ///< the size is not that of the expected kind, or not that in the packet's header
  kMagic,     ///< a packet of another protocol or version
  kKind,      ///< a packet of another kind, such as one that the receiver itself has sent
  kSession,   ///< a packet of another link session
  kMac,       ///< made without the key, or corrupted
  kSequence,  ///< repeated, or overtaken by a newer packet
  kContents,  ///< authentic, but with an unknown mode, a non-zero byte where zero is required, a
              ///< number that is not finite or out of bounds, or a nonce of another hello
};
inline constexpr std::size_t kLinkRefusals = 8;
/// The reason's name in summaries, such as "sequence".
const char* to_string(LinkRefusal refusal) noexcept;

/// Call this before any other function of this header; repeated calls are harmless. Errors: kBug if
/// the system has no source of randomness.
Result<void> start_link();

/// A new random key, and a new random nonce.
LinkKey random_link_key() noexcept;
LinkNonce random_nonce() noexcept;

/// session_key() returns the key for the commands and states of a link session, derived from the
/// shared key and the nonces of host and drive. session_number() returns the number of the link
/// session, which the headers of these packets contain.
LinkKey session_key(const LinkKey& shared, const LinkNonce& host, const LinkNonce& drive) noexcept;
std::uint64_t session_number(const LinkNonce& drive) noexcept;

/// Writes a packet to `out`. Returns the number of bytes written, which is the size of this kind of
/// packet. Returns 0 if `out` is shorter, or if decode() would refuse the contents. `key` is the
/// shared key for hello and welcome, and session_key() for the other packets. There is an instance
/// of this template for each kind of packet except denials, which have no key.
template <typename Packet>
std::size_t encode(const Packet& packet, const LinkKey& key, std::span<std::uint8_t> out) noexcept;

std::size_t encode(const DenialPacket& packet, std::span<std::uint8_t> out) noexcept;

/// If a datagram has the size, magic, version and kind of a hello, reads the host's nonce from the
/// datagram and returns true. Whether the hello is authentic is not checked.
bool hello_nonce(std::span<const std::uint8_t> bytes, LinkNonce& nonce) noexcept;

/// The kind of a datagram according to its header and size, without authentication. If the
/// datagram is not a packet, the result is kHello, and decode() then refuses the datagram.
PacketKind claimed_kind(std::span<const std::uint8_t> bytes) noexcept;

// Each decode() reads one kind of packet, and returns kNone if it accepts the packet. `packet` and
// `last_sequence` change only in this case.

/// A repeated hello is accepted. An attacker who repeats an old hello gets a welcome, but does not
/// have the key that commands require.
LinkRefusal decode(std::span<const std::uint8_t> bytes, const LinkKey& key,
                   HelloPacket& packet) noexcept;
/// `asked` is the nonce that the host sent in its hello.
LinkRefusal decode(std::span<const std::uint8_t> bytes, const LinkKey& key, const LinkNonce& asked,
                   WelcomePacket& packet) noexcept;
/// `asked` is the nonce that the host sent in its hello. A denial is not authenticated.
LinkRefusal decode(std::span<const std::uint8_t> bytes, const LinkNonce& asked,
                   DenialPacket& packet) noexcept;
/// `last_sequence` is the sequence number of the last accepted packet of this kind in the link
/// session; 0 at the start of the link session. If the result is kContents, `refused` says which
/// field was refused: its fault is kRefusedState. There are instances for commands and states.
template <typename Packet>
LinkRefusal decode(std::span<const std::uint8_t> bytes, const LinkKey& key, std::uint64_t session,
                   std::uint64_t& last_sequence, Packet& packet, FaultDetail& refused) noexcept;
/// The same, for a caller that needs no field.
template <typename Packet>
LinkRefusal decode(std::span<const std::uint8_t> bytes, const LinkKey& key, std::uint64_t session,
                   std::uint64_t& last_sequence, Packet& packet) noexcept {
  FaultDetail ignored;
  return decode(bytes, key, session, last_sequence, packet, ignored);
}

/// The number of accepted packets, and the number of refused packets for each reason.
struct LinkCounts {
  std::array<std::uint64_t, kLinkRefusals> by_refusal{};  ///< element kNone: accepted
  void add(LinkRefusal refusal) noexcept { ++by_refusal[static_cast<std::size_t>(refusal)]; }
  std::uint64_t accepted() const noexcept { return by_refusal[0]; }
  std::uint64_t refused() const noexcept;
};

}  // namespace trocar
