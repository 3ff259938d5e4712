// SPDX-License-Identifier: Apache-2.0
// The device link: what the loop's host and a drive say to each other over UDP. One datagram is
// one packet of a fixed size; every number is little-endian; floating-point numbers are IEEE 754
// binary64. The same to the byte, with the course of a session, in device_protocol.md.
//
//   offset  bytes  header of every packet
//        0      4  magic "TRCR"
//        4      1  version, 1
//        5      1  kind: 1 hello, 2 welcome, 3 command, 4 state
//        6      2  size of the whole packet in bytes
//        8      8  session: the first 8 bytes of the drive's nonce; 0 in hello
//       16      8  sequence, from 1, strictly increasing a direction and session; 1 in hello,
//       welcome 24      8  time on the sender's clock, ns, signed (a state's: time of its encoders)
//
//   hello, 96    32: 16 host's nonce | 48: 8 period of the host's loop, s | 56: 1 fresh | 57: 7
//   zero welcome, 112 32: 16 host's nonce | 48: 16 drive's nonce | 64: 8 drive's period, s |
//                72: 1 clock | 73: 7 zero
//   command, 144 32: 1 mode | 33: 7 zero | 40: 8 sequence of the newest state seen |
//                48: 8 x 8 motor torques, N*m
//   state, 208   32: 1 mode | 33: 1 motor faults | 34: 6 zero | 40: 8 sequence of the newest
//                command taken | 48: 16 x 8 encoder angles, rad
//   The last 32 bytes of each are the MAC of all before them: BLAKE2b-256 with a key of 32 bytes
//   (libsodium's crypto_generichash). hello and welcome: the shared key; command and state: the
//   session's key, BLAKE2b-256 under the shared key of "trocar link 1" | host's nonce | drive's.
//
// Laws (tests/formats/session/device_protocol_test.cpp):
//  1. What decode accepts, encode gives again byte for byte, and only who has the key made it.
//  2. Nothing is accepted twice, nor after something newer, nor in another session or direction.
//  3. A refused packet changes nothing.
// No function but start_link allocates, locks, throws or looks at a clock.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "formats/base/result.h"

namespace trocar {

inline constexpr std::size_t kLinkKeyBytes = 32, kLinkNonceBytes = 16, kLinkMacBytes = 32;
inline constexpr std::size_t kHelloBytes = 96, kWelcomeBytes = 112, kCommandBytes = 144,
                             kStateBytes = 208;
inline constexpr std::size_t kLargestPacketBytes = kStateBytes;
inline constexpr std::size_t kLinkMotors = 8, kLinkEncoders = 16;
/// Beyond these a number is refused: no device of this kind has them.
inline constexpr double kLinkMaxTorque_Nm = 1000, kLinkMaxAngle_rad = 1000;
inline constexpr double kLinkMinPeriod_s = 1e-5, kLinkMaxPeriod_s = 0.1;

struct LinkKey {
  std::array<std::uint8_t, kLinkKeyBytes> bytes{};
};
using LinkNonce = std::array<std::uint8_t, kLinkNonceBytes>;

enum class PacketKind : std::uint8_t { kHello = 1, kWelcome = 2, kCommand = 3, kState = 4 };

enum class LinkClock : std::uint8_t {
  kReal = 1,      ///< the drive goes by its own clock
  kLockStep = 2,  ///< the drive's time goes on by one host's period a torque command
};
enum class CommandMode : std::uint8_t {
  kHold = 1,    ///< torques must be zero; lock-step: time stands still, a state is sent
  kTorque = 2,  ///< torques to hold until the next command
  kStop = 3,    ///< torques must be zero; the session is over
};
enum class DriveMode : std::uint8_t {
  kReady = 1,     ///< torques are zero, a torque command is taken
  kTorque = 2,    ///< the last command's torques are applied
  kWatchdog = 3,  ///< commands fell silent: torques are zero until one that has seen it asks for
                  ///< none
  kEmergencyStop = 4,  ///< pressed, or released and no such command has come yet:
                       ///< torques are zero whatever is commanded
};

struct HelloPacket {
  std::int64_t time_ns = 0;
  LinkNonce host_nonce{};
  double period_s = 0;
  bool fresh = true;  ///< a simulated world is to begin anew
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
  CommandMode mode = CommandMode::kHold;
  std::uint64_t state_seen = 0;
  std::array<double, kLinkMotors> tau_motor_Nm{};  ///< leg-major: th1, th4 of leg 1, ...
  friend bool operator==(const CommandPacket&, const CommandPacket&) = default;
};
struct StatePacket {
  std::uint64_t session = 0, sequence = 0;
  std::int64_t time_ns = 0;
  DriveMode mode = DriveMode::kReady;
  std::uint8_t motor_faults = 0;  ///< bit i: motor i's current does not follow its command
  std::uint64_t command_taken = 0;
  std::array<double, kLinkEncoders> encoder_rad{};  ///< leg-major: th1..th4 of leg 1, ...
  friend bool operator==(const StatePacket&, const StatePacket&) = default;
};

/// Why a packet was not accepted; the first of these that applies.
enum class LinkRefusal : std::uint8_t {
  kNone,      ///< accepted
  kSize,      ///< no packet of the wanted kind has this many bytes, or it states another size
  kMagic,     ///< not this protocol, or another version
  kKind,      ///< of another kind, as one's own packet sent back
  kSession,   ///< of another session
  kMac,       ///< not made with the key, or changed on its way
  kSequence,  ///< seen before, or overtaken by a newer one
  kContents,  ///< authentic, and yet: an unknown mode, bytes that must be zero, a number that is
              ///< not finite or beyond bounds, or a nonce that is not the asked one
};
inline constexpr std::size_t kLinkRefusals = 8;
/// A word for summaries, such as "sequence".
const char* to_word(LinkRefusal refusal) noexcept;

/// Once before all else in a program; may be repeated. Fails (bug) if the system has no randomness.
Result<void> start_link();

/// Fresh from the system's random numbers.
LinkKey random_link_key() noexcept;
LinkNonce random_nonce() noexcept;

/// What command and state of a session are made with, and its number in their headers.
LinkKey session_key(const LinkKey& shared, const LinkNonce& host, const LinkNonce& drive) noexcept;
std::uint64_t session_number(const LinkNonce& drive) noexcept;

/// Bytes written: the kind's size; 0 if `out` is shorter, or the packet is one that decode would
/// refuse for its contents. The key: shared for hello and welcome, the session's for the others.
std::size_t encode(const HelloPacket& packet, const LinkKey& key,
                   std::span<std::uint8_t> out) noexcept;
std::size_t encode(const WelcomePacket& packet, const LinkKey& key,
                   std::span<std::uint8_t> out) noexcept;
std::size_t encode(const CommandPacket& packet, const LinkKey& key,
                   std::span<std::uint8_t> out) noexcept;
std::size_t encode(const StatePacket& packet, const LinkKey& key,
                   std::span<std::uint8_t> out) noexcept;

/// The kind that a datagram claims to be by its header and size; kHello if it is none (which
/// decode then refuses). Nothing is authenticated.
PacketKind claimed_kind(std::span<const std::uint8_t> bytes) noexcept;

/// `packet` and `last_sequence` change only if the packet is accepted. A hello has no history: who
/// sends an old one again gets a welcome, whose session he cannot speak in.
LinkRefusal decode(std::span<const std::uint8_t> bytes, const LinkKey& key,
                   HelloPacket& packet) noexcept;
/// `asked`: the nonce of one's own hello.
LinkRefusal decode(std::span<const std::uint8_t> bytes, const LinkKey& key, const LinkNonce& asked,
                   WelcomePacket& packet) noexcept;
/// `last_sequence`: of the session's packets of this kind, 0 at its start.
LinkRefusal decode(std::span<const std::uint8_t> bytes, const LinkKey& key, std::uint64_t session,
                   std::uint64_t& last_sequence, CommandPacket& packet) noexcept;
LinkRefusal decode(std::span<const std::uint8_t> bytes, const LinkKey& key, std::uint64_t session,
                   std::uint64_t& last_sequence, StatePacket& packet) noexcept;

/// Packets by what became of them.
struct LinkCounts {
  std::array<std::uint64_t, kLinkRefusals> by_refusal{};  ///< [kNone]: accepted
  void add(LinkRefusal refusal) noexcept { ++by_refusal[static_cast<std::size_t>(refusal)]; }
  std::uint64_t accepted() const noexcept { return by_refusal[0]; }
  std::uint64_t refused() const noexcept;
};

}  // namespace trocar
