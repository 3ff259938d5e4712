// SPDX-License-Identifier: Apache-2.0
// The device link's packets: their bytes are those of formats/session/device_link.md (written here
// a second time, with libsodium alone; the page's vectors are read by e2e/device_link_page_test.py),
// and only unchanged, new packets are accepted.
#include "formats/session/device_protocol.h"

#include <gtest/gtest.h>
#include <sodium.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <iterator>
#include <limits>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "tests/support/link_corpus.h"

namespace trocar {
namespace {

using Bytes = std::vector<std::uint8_t>;

LinkKey counted_key(std::uint8_t first) {
  LinkKey key;
  for (std::size_t i = 0; i < key.bytes.size(); ++i)
    key.bytes[i] = static_cast<std::uint8_t>(first + i);
  return key;
}

const LinkKey kKey = counted_key(1);

HelloPacket hello() {
  HelloPacket packet;
  packet.time_ns = -5;
  packet.host_nonce = {9, 8, 7};
  packet.period_s = 1e-3;
  return packet;
}
WelcomePacket welcome() {
  return {77, {9, 8, 7}, {1, 2, 3, 4, 5, 6, 7, 8, 9}, 2.5e-4, LinkClock::kLockStep};
}
CommandPacket command(std::uint64_t sequence = 3) {
  CommandPacket packet{0x0807060504030201, sequence, 123456789012345, CommandMode::kTorque, 41, {}};
  for (std::size_t i = 0; i < kLinkMotors; ++i)
    packet.tau_motor_Nm[i] = 0.1 * static_cast<double>(i) - 0.35;
  return packet;
}
StatePacket state(std::uint64_t sequence = 4) {
  StatePacket packet{0x0807060504030201, sequence, -1, DriveMode::kWatchdog, 0x81, 3, {}};
  for (std::size_t i = 0; i < kLinkEncoders; ++i)
    packet.encoder_rad[i] = std::sin(static_cast<double>(i));
  return packet;
}

WrenchCommandPacket wrench_command(std::uint64_t sequence = 3) {
  return {0x0807060504030201,   sequence,          123456789012345, CommandMode::kTorque, 41,
          {1.25, -0.5, 999.75}, {0.1, -1000, 1e-9}};
}
PoseStatePacket pose_state(std::uint64_t sequence = 4) {
  return {0x0807060504030201,
          sequence,
          -1,
          DriveMode::kWatchdog,
          0x81,
          0x80000001,
          3,
          {0.1, -9.5, 1 / 3.0},
          {0.5, -0.5, 0.5, -0.5}};
}

template <typename Packet>
Bytes encoded(const Packet& packet, const LinkKey& key = kKey) {
  Bytes bytes(kMaxPacketBytes);
  bytes.resize(encode(packet, key, bytes));
  return bytes;
}

/// The layout of device_link.md: little-endian fields one after another.
struct Page {
  Bytes bytes;
  Page& number(std::uint64_t value, int count) {
    for (; count > 0; --count, value >>= 8)
      bytes.push_back(static_cast<std::uint8_t>(value & 0xff));
    return *this;
  }
  Page& real(double value) {
    std::uint64_t bits = 0;
    std::memcpy(&bits, &value, 8);
    return number(bits, 8);
  }
  template <std::size_t N>
  Page& reals(const std::array<double, N>& values) {
    for (const double value : values)
      real(value);
    return *this;
  }
  template <std::size_t N>
  Page& raw(const std::array<std::uint8_t, N>& values) {
    bytes.insert(bytes.end(), values.begin(), values.end());
    return *this;
  }
  Page& header(std::uint64_t kind, std::uint64_t size, std::uint64_t session,
               std::uint64_t sequence, std::int64_t time_ns) {
    return number(0x52435254, 4)
        .number(1, 1)
        .number(kind, 1)
        .number(size, 2)
        .number(session, 8)
        .number(sequence, 8)
        .number(static_cast<std::uint64_t>(time_ns), 8);
  }
  Bytes sealed(const LinkKey& key = kKey) const {
    Bytes all = bytes;
    all.resize(bytes.size() + 32);
    crypto_generichash(all.data() + bytes.size(), 32, bytes.data(), bytes.size(), key.bytes.data(),
                       32);
    return all;
  }
};

/// A number of a packet, and a value just beyond what is accepted.
using Numbers = std::vector<std::pair<double*, double>>;
template <std::size_t N>
void add(Numbers& numbers, std::array<double, N>& values, double beyond) {
  for (double& value : values)
    numbers.emplace_back(&value, beyond);
}

/// Name, size and a sample of each kind of packet; its layout; its numbers.
template <typename Packet>
struct Of;

template <>
struct Of<HelloPacket> {
  static constexpr const char* kName = "hello";
  static constexpr PacketKind kKind = PacketKind::kHello;
  static constexpr std::size_t kBytes = 96;
  static HelloPacket sample(std::uint64_t /*sequence*/) { return hello(); }
  static Page page(const HelloPacket& h) {
    Page page;
    page.header(1, 96, 0, 1, h.time_ns)
        .raw(h.host_nonce)
        .real(h.period_s)
        .number(h.resets_world ? 1 : 0, 1)
        .number(static_cast<std::uint64_t>(h.contents), 7);
    return page;
  }
  static Numbers numbers(HelloPacket& h) { return {{&h.period_s, 0.1001}}; }
  static std::vector<std::size_t> zeros() { return {58, 59, 60, 61, 62, 63}; }
};
template <>
struct Of<WelcomePacket> {
  static constexpr const char* kName = "welcome";
  static constexpr PacketKind kKind = PacketKind::kWelcome;
  static constexpr std::size_t kBytes = 112;
  static WelcomePacket sample(std::uint64_t /*sequence*/) { return welcome(); }
  static Page page(const WelcomePacket& w) {
    Page page;
    page.header(2, 112, 0x0807060504030201, 1, w.time_ns)
        .raw(w.host_nonce)
        .raw(w.drive_nonce)
        .real(w.period_s)
        .number(static_cast<std::uint64_t>(w.clock), 8);
    return page;
  }
  static Numbers numbers(WelcomePacket& w) { return {{&w.period_s, 0.1001}}; }
  static std::vector<std::size_t> zeros() { return {73, 74, 75, 76, 77, 78, 79}; }
};
template <>
struct Of<CommandPacket> {
  static constexpr const char* kName = "command";
  static constexpr PacketKind kKind = PacketKind::kCommand;
  static constexpr std::size_t kBytes = 144;
  static CommandPacket sample(std::uint64_t sequence) { return command(sequence); }
  static Page page(const CommandPacket& c) {
    Page page;
    page.header(3, 144, c.session, c.sequence, c.time_ns)
        .number(static_cast<std::uint64_t>(c.mode), 8)
        .number(c.state_seen, 8)
        .reals(c.tau_motor_Nm);
    return page;
  }
  static Numbers numbers(CommandPacket& c) {
    Numbers out;
    add(out, c.tau_motor_Nm, 1000.1);
    return out;
  }
  static std::vector<std::size_t> zeros() { return {33, 34, 35, 36, 37, 38, 39}; }
};
template <>
struct Of<StatePacket> {
  static constexpr const char* kName = "state";
  static constexpr PacketKind kKind = PacketKind::kState;
  static constexpr std::size_t kBytes = 208;
  static StatePacket sample(std::uint64_t sequence) { return state(sequence); }
  static Page page(const StatePacket& s) {
    Page page;
    page.header(4, 208, s.session, s.sequence, s.time_ns)
        .number(static_cast<std::uint64_t>(s.mode), 1)
        .number(s.motor_faults, 7)
        .number(s.command_taken, 8)
        .reals(s.encoder_rad);
    return page;
  }
  static Numbers numbers(StatePacket& s) {
    Numbers out;
    add(out, s.encoder_rad, 1000.1);
    return out;
  }
  static std::vector<std::size_t> zeros() { return {34, 35, 36, 37, 38, 39}; }
};
template <>
struct Of<WrenchCommandPacket> {
  static constexpr const char* kName = "wrench command";
  static constexpr PacketKind kKind = PacketKind::kWrenchCommand;
  static constexpr std::size_t kBytes = 128;
  static WrenchCommandPacket sample(std::uint64_t sequence) { return wrench_command(sequence); }
  static Page page(const WrenchCommandPacket& c) {
    Page page;
    page.header(6, 128, c.session, c.sequence, c.time_ns)
        .number(static_cast<std::uint64_t>(c.mode), 8)
        .number(c.state_seen, 8)
        .reals(c.force_N)
        .reals(c.moment_Nm);
    return page;
  }
  static Numbers numbers(WrenchCommandPacket& c) {
    Numbers out;
    add(out, c.force_N, 1000.1);
    add(out, c.moment_Nm, 1000.1);
    return out;
  }
  static std::vector<std::size_t> zeros() { return {33, 34, 35, 36, 37, 38, 39}; }
};
template <>
struct Of<PoseStatePacket> {
  static constexpr const char* kName = "pose state";
  static constexpr PacketKind kKind = PacketKind::kPoseState;
  static constexpr std::size_t kBytes = 136;
  static PoseStatePacket sample(std::uint64_t sequence) { return pose_state(sequence); }
  static Page page(const PoseStatePacket& s) {
    Page page;
    page.header(7, 136, s.session, s.sequence, s.time_ns)
        .number(static_cast<std::uint64_t>(s.mode), 1)
        .number(s.faults, 3)
        .number(s.buttons, 4)
        .number(s.command_taken, 8)
        .reals(s.p_m)
        .reals(s.q);
    return page;
  }
  static Numbers numbers(PoseStatePacket& s) {
    Numbers out;
    add(out, s.p_m, 10.1);
    add(out, s.q, 1.0);
    return out;
  }
  static std::vector<std::size_t> zeros() { return {34, 35}; }
};

template <typename Packet>
constexpr bool kIsOfSession = requires(Packet packet) {
  packet.session;
};

template <typename Packet>
LinkRefusal open(const Bytes& bytes, Packet& packet, const LinkKey& key = kKey,
                 const LinkNonce& asked = hello().host_nonce,
                 std::uint64_t session = command().session) {
  std::uint64_t last = 0;
  if constexpr (kIsOfSession<Packet>)
    return decode(bytes, key, session, last, packet);
  else if constexpr (requires { packet.drive_nonce; })
    return decode(bytes, key, asked, packet);
  else
    return decode(bytes, key, packet);
}

template <typename Packet>
LinkRefusal refusal_of(const Page& page) {
  Packet read;
  const LinkRefusal refusal = open(page.sealed(), read);
  EXPECT_TRUE(refusal == LinkRefusal::kNone || read == Packet{}) << "a refused packet is read";
  return refusal;
}
template <typename Packet>
LinkRefusal refusal_of(const Packet& packet) {
  const LinkRefusal refusal = refusal_of<Packet>(Of<Packet>::page(packet));
  EXPECT_EQ(encoded(packet).empty(), refusal != LinkRefusal::kNone)
      << "encode and decode disagree on the contents";
  return refusal;
}

template <typename Packet>
void expect_round_trip(const Packet& packet) {
  Packet read;
  ASSERT_EQ(open(encoded(packet), read), LinkRefusal::kNone);
  EXPECT_EQ(read, packet);
  EXPECT_EQ(encoded(read), encoded(packet));
}

class DeviceProtocol : public testing::Test {
 protected:
  void SetUp() override { ASSERT_TRUE(start_link()); }
};

template <typename Packet>
class EachPacket : public DeviceProtocol {};
using AllPackets = testing::Types<HelloPacket, WelcomePacket, CommandPacket, StatePacket,
                                  WrenchCommandPacket, PoseStatePacket>;
TYPED_TEST_SUITE(EachPacket, AllPackets);

TYPED_TEST(EachPacket, HasTheBytesOfTheDocumentation) {
  using This = Of<TypeParam>;
  const TypeParam packet = This::sample(3);
  const Bytes bytes = encoded(packet);
  EXPECT_EQ(bytes, This::page(packet).sealed());
  EXPECT_EQ(bytes.size(), This::kBytes);
  EXPECT_EQ(claimed_kind(bytes), This::kKind);
  expect_round_trip(packet);
  Bytes small(This::kBytes - 1, 0xaa);
  EXPECT_EQ(encode(packet, kKey, small), 0U);
  EXPECT_EQ(small, Bytes(This::kBytes - 1, 0xaa)) << "a too short buffer is not written to";
}

// The corpus was made from device_link.md by a Python program.
TYPED_TEST(EachPacket, OfAnotherImplementationIsAccepted) {
  std::string name = Of<TypeParam>::kName;
  std::replace(name.begin(), name.end(), ' ', '_');
  std::ifstream stream(TROCAR_CORPUS "/packet/" + name + ".bin", std::ios::binary);
  const Bytes file(std::istreambuf_iterator<char>(stream), {});
  const LinkKey key = link_corpus::key_for<TypeParam>();
  TypeParam read;
  EXPECT_EQ(open(file, read, key, link_corpus::kHost, session_number(link_corpus::kDrive)),
            LinkRefusal::kNone);
  EXPECT_EQ(read, std::get<TypeParam>(link_corpus::packets()));
  EXPECT_EQ(encoded(read, key), file);
}

TYPED_TEST(EachPacket, WithAFlippedBitOrAnotherLengthIsRefusedAndChangesNothing) {
  const Bytes good = encoded(Of<TypeParam>::sample(3));
  for (std::size_t bit = 0; bit < 8 * good.size(); ++bit) {
    Bytes bad = good;
    bad[bit / 8] ^= static_cast<std::uint8_t>(1U << (bit % 8));
    TypeParam read{};
    ASSERT_NE(open(bad, read), LinkRefusal::kNone) << "bit " << bit;
    ASSERT_EQ(read, TypeParam{});
  }
  for (std::size_t size = 0; size <= good.size() + 100; ++size) {
    if (size == good.size()) continue;
    Bytes bad = good;
    bad.resize(size);
    TypeParam read{};
    ASSERT_NE(open(bad, read), LinkRefusal::kNone) << "length " << size;
  }
}

// Packets made with the right key are refused if their contents are invalid.
TYPED_TEST(EachPacket, WithInvalidContentsIsRefused) {
  using This = Of<TypeParam>;
  TypeParam sample = This::sample(3);
  const std::size_t numbers = This::numbers(sample).size();
  for (std::size_t i = 0; i < numbers; ++i) {
    for (const double bad : {std::nan(""), -std::nan(""), std::numeric_limits<double>::infinity(),
                             1000.1, -1e300, This::numbers(sample)[i].second}) {
      TypeParam packet = This::sample(3);
      *This::numbers(packet)[i].first = bad;
      EXPECT_EQ(refusal_of(packet), LinkRefusal::kContents) << i << ": " << bad;
    }
  }
  for (const std::size_t at : This::zeros()) {
    Page page = This::page(sample);
    page.bytes[at] = 1;
    EXPECT_EQ(refusal_of<TypeParam>(page), LinkRefusal::kContents) << at;
  }
  if constexpr (kIsOfSession<TypeParam>) {
    EXPECT_EQ(refusal_of<TypeParam>(This::page(This::sample(0))), LinkRefusal::kSequence);
  }
}

template <typename Packet>
class EachPacketOfASession : public DeviceProtocol {};
using PacketsOfASession =
    testing::Types<CommandPacket, StatePacket, WrenchCommandPacket, PoseStatePacket>;
TYPED_TEST_SUITE(EachPacketOfASession, PacketsOfASession);

TYPED_TEST(EachPacketOfASession, IsAcceptedOnceInItsOrderSessionDirectionAndKey) {
  using This = Of<TypeParam>;
  std::uint64_t last = 0;
  const std::uint64_t session = command().session;
  TypeParam read;
  const auto give = [&](std::uint64_t sequence) {
    return decode(encoded(This::sample(sequence)), kKey, session, last, read);
  };
  EXPECT_EQ(give(5), LinkRefusal::kNone);
  EXPECT_EQ(give(5), LinkRefusal::kSequence);
  EXPECT_EQ(give(4), LinkRefusal::kSequence);
  EXPECT_EQ(read.sequence, 5U);
  EXPECT_EQ(give(900), LinkRefusal::kNone) << "gaps are losses, not attacks";
  EXPECT_EQ(give(899), LinkRefusal::kSequence);
  // A forged packet with a high sequence does not block the authentic ones.
  const Bytes forged = This::page(This::sample(1000000)).sealed(counted_key(2));
  EXPECT_EQ(decode(forged, kKey, session, last, read), LinkRefusal::kMac);
  const Bytes next = encoded(This::sample(901));
  EXPECT_EQ(decode(next, kKey, session + 1, last, read), LinkRefusal::kSession);
  // The session number is right, but the key is still wrong.
  const LinkKey other = session_key(kKey, hello().host_nonce, {2});
  EXPECT_EQ(decode(next, other, session, last, read), LinkRefusal::kMac);
  for (const Bytes& kind : {encoded(command(901)), encoded(state(901)),
                            encoded(wrench_command(901)), encoded(pose_state(901))}) {
    if (claimed_kind(kind) == This::kKind) continue;
    EXPECT_EQ(decode(kind, kKey, session, last, read), LinkRefusal::kKind);
  }
  EXPECT_EQ(read.sequence, 900U);
  EXPECT_EQ(last, 900U);
  EXPECT_EQ(give(901), LinkRefusal::kNone);
}

TEST_F(DeviceProtocol, SessionKeyAndNumberFollowFromTheNonces) {
  Page text;
  for (const char c : std::string("trocar link 1"))
    text.number(static_cast<std::uint64_t>(c), 1);
  text.raw(welcome().host_nonce).raw(welcome().drive_nonce);
  const Bytes sealed = text.sealed();
  const LinkKey of_welcome = session_key(kKey, welcome().host_nonce, welcome().drive_nonce);
  EXPECT_TRUE(std::equal(of_welcome.bytes.begin(), of_welcome.bytes.end(), sealed.end() - 32));
  EXPECT_EQ(session_number(welcome().drive_nonce), 0x0807060504030201U);
  // Every byte of both nonces changes the session key.
  const LinkKey key = session_key(kKey, {}, {});
  for (std::size_t i = 0; i < kLinkNonceBytes; ++i) {
    LinkNonce nonce{};
    nonce[i] = 1;
    EXPECT_NE(session_key(kKey, nonce, {}).bytes, key.bytes);
    EXPECT_NE(session_key(kKey, {}, nonce).bytes, key.bytes);
  }
  EXPECT_NE(random_nonce(), random_nonce());
  EXPECT_NE(random_link_key().bytes, random_link_key().bytes);
  HelloPacket read_hello;
  EXPECT_EQ(open(encoded(welcome()), read_hello), LinkRefusal::kKind);
  WelcomePacket read_welcome;
  EXPECT_EQ(decode(encoded(welcome()), kKey, {1, 1, 1}, read_welcome), LinkRefusal::kContents)
      << "a welcome to another host's hello";
}

// A denial has no MAC: it tells a host that lacks the key.
TEST_F(DeviceProtocol, ADenialIsSmallerThanTheHelloAndIsForItsHostOnly) {
  static_assert(kDenialBytes < kHelloBytes);
  for (const DenialReason reason : {DenialReason::kKey, DenialReason::kBusy, DenialReason::kKind}) {
    const DenialPacket denial{7, hello().host_nonce, reason};
    Bytes bytes(kDenialBytes);
    ASSERT_EQ(encode(denial, bytes), kDenialBytes);
    Page page;
    page.header(5, 56, 0, 1, 7)
        .raw(hello().host_nonce)
        .number(static_cast<std::uint64_t>(reason), 8);
    EXPECT_EQ(bytes, page.bytes);
    EXPECT_EQ(claimed_kind(bytes), PacketKind::kDenial);
    DenialPacket read;
    ASSERT_EQ(decode(bytes, hello().host_nonce, read), LinkRefusal::kNone);
    EXPECT_EQ(read, denial);
    LinkNonce other = hello().host_nonce;
    other[15] ^= 1;
    EXPECT_EQ(decode(bytes, other, read), LinkRefusal::kContents);
    // Every changed byte but those of the time (24 to 31) and of the reason is refused; of the
    // reasons only the three are taken.
    for (std::size_t at = 0; at < bytes.size(); ++at) {
      Bytes changed = bytes;
      changed[at] ^= 0x40;
      EXPECT_EQ(decode(changed, hello().host_nonce, read) == LinkRefusal::kNone,
                at >= 24 && at < 32)
          << at;
    }
    for (std::size_t size = 0; size < bytes.size(); ++size)
      EXPECT_NE(decode(std::span(bytes).first(size), hello().host_nonce, read), LinkRefusal::kNone);
    EXPECT_EQ(encode(denial, std::span(bytes).first(55)), 0U);
  }
  LinkNonce nonce{};
  Bytes forged = encoded(hello());
  forged.back() ^= 1;  // the MAC
  EXPECT_TRUE(hello_nonce(forged, nonce));
  EXPECT_EQ(nonce, hello().host_nonce);
  for (const Bytes& other : {encoded(welcome()), encoded(command()), encoded(state()), Bytes(96),
                             Bytes(), Bytes(5, 'T')})
    EXPECT_FALSE(hello_nonce(other, nonce));
}

TEST_F(DeviceProtocol, TheLargestNumbersAreAccepted) {
  const std::uint64_t last = std::numeric_limits<std::uint64_t>::max();
  CommandPacket torques = command(last);
  torques.tau_motor_Nm = {kLinkMaxTorque_Nm, -kLinkMaxTorque_Nm, 5e-324, -0.0, 1 / 3.0, 0, 0, 0};
  expect_round_trip(torques);
  WrenchCommandPacket wrench = wrench_command(last);
  wrench.force_N = {kLinkMaxForce_N, -kLinkMaxForce_N, 5e-324};
  wrench.moment_Nm = {-kLinkMaxMoment_Nm, kLinkMaxMoment_Nm, -0.0};
  expect_round_trip(wrench);
  PoseStatePacket farthest = pose_state();
  farthest.p_m = {kLinkMaxPosition_m, -kLinkMaxPosition_m, -0.0};
  farthest.q = {0, 0, 0, -1};
  expect_round_trip(farthest);
  // The norm of the quaternion.
  for (const double norm : {0.0, 0.5, 0.9989, 1.0011, 2.0, 1e200, 0.9991, 1.0, 1.0009}) {
    PoseStatePacket pose = pose_state();
    pose.q = {0.6 * norm, 0, -0.8 * norm, 0};
    EXPECT_EQ(refusal_of(pose) == LinkRefusal::kNone, std::abs(norm - 1) < 1e-3) << norm;
  }
}

TEST_F(DeviceProtocol, InvalidModesAreRefused) {
  for (int mode = 0; mode < 256; ++mode) {
    const auto command_mode = static_cast<CommandMode>(mode);
    const auto drive_mode = static_cast<DriveMode>(mode);
    CommandPacket c = command();
    c.mode = command_mode;
    EXPECT_EQ(refusal_of(c) == LinkRefusal::kNone, mode == 2) << "hold and stop carry no torques";
    c.tau_motor_Nm = {};
    EXPECT_EQ(refusal_of(c) == LinkRefusal::kNone, mode >= 1 && mode <= 3);
    WrenchCommandPacket w = wrench_command();
    w.mode = command_mode;
    EXPECT_EQ(refusal_of(w) == LinkRefusal::kNone, mode == 2) << "hold and stop carry no wrench";
    w.force_N = {};
    EXPECT_EQ(refusal_of(w) == LinkRefusal::kNone, mode == 2) << "nor a moment alone";
    w.moment_Nm = {};
    EXPECT_EQ(refusal_of(w) == LinkRefusal::kNone, mode >= 1 && mode <= 3);
    StatePacket s = state();
    s.mode = drive_mode;
    EXPECT_EQ(refusal_of(s) == LinkRefusal::kNone, mode >= 1 && mode <= 4);
    PoseStatePacket p = pose_state();
    p.mode = drive_mode;
    EXPECT_EQ(refusal_of(p) == LinkRefusal::kNone, mode >= 1 && mode <= 4);
    p = pose_state();
    p.faults = static_cast<std::uint8_t>(mode);
    EXPECT_EQ(refusal_of(p), LinkRefusal::kNone);
    WelcomePacket answer = welcome();
    answer.clock = static_cast<LinkClock>(mode);
    EXPECT_EQ(refusal_of(answer) == LinkRefusal::kNone, mode == 1 || mode == 2);
    HelloPacket asked = hello();
    asked.contents = static_cast<LinkContents>(mode);
    EXPECT_EQ(refusal_of(asked) == LinkRefusal::kNone, mode <= 1);
  }
}

// A hello for drives with angles has the bytes that it had before there were others.
TEST_F(DeviceProtocol, AHelloNamesTheContents) {
  HelloPacket asked = hello();
  EXPECT_EQ(encoded(asked)[57], 0);
  asked.contents = LinkContents::kPose;
  EXPECT_EQ(encoded(asked)[57], 1);
  expect_round_trip(asked);
  std::ifstream stream(TROCAR_CORPUS "/packet/hello_pose.bin", std::ios::binary);
  const Bytes file(std::istreambuf_iterator<char>(stream), {});
  EXPECT_EQ(encoded(link_corpus::hello_for_poses(), link_corpus::shared_key()), file);
}

// What an operator reads of a state that was refused.
TEST_F(DeviceProtocol, ARefusalNamesTheField) {
  const double nan = std::nan("");
  const auto told = [](auto packet, std::size_t byte = 0) {
    Page page = Of<decltype(packet)>::page(packet);
    if (byte != 0) page.bytes[byte] = 1;
    decltype(packet) read{};
    std::uint64_t last = 0;
    FaultDetail refused;
    EXPECT_EQ(decode(page.sealed(), kKey, packet.session, last, read, refused),
              LinkRefusal::kContents);
    EXPECT_EQ(refused.fault, Fault::kRefusedState);
    EXPECT_TRUE(is_known(refused));
    return measured(refused);
  };
  StatePacket angles = state();
  angles.encoder_rad[6] = nan;
  EXPECT_EQ(told(angles), "angle theta 3 of leg 2 nan deg, limit 5.73e+04 deg");
  PoseStatePacket pose = pose_state();
  pose.p_m[1] = nan;
  EXPECT_EQ(told(pose), "measured position y nan mm, limit 1e+04 mm");
  pose.p_m[1] = -120;  // mm instead of m
  EXPECT_EQ(told(pose), "measured position y -1.2e+05 mm, at least -1e+04 mm");
  pose = pose_state();
  pose.q[3] = nan;
  EXPECT_EQ(told(pose), "length of the measured quaternion nan, limit 1");
  pose.q = {0, 0, 0, 0};
  EXPECT_EQ(told(pose), "length of the measured quaternion 0, at least 1");
  pose = pose_state();
  pose.mode = static_cast<DriveMode>(9);
  EXPECT_EQ(told(pose), "mode 9, limit 4");
  EXPECT_EQ(told(pose_state(), 34), "a byte that must be zero is not");
  // A packet that is accepted, or refused for another reason, says nothing.
  PoseStatePacket read;
  std::uint64_t last = 0;
  FaultDetail refused;
  const Bytes good = encoded(pose_state());
  EXPECT_EQ(decode(good, kKey, pose.session, last, read, refused), LinkRefusal::kNone);
  EXPECT_EQ(decode(good, kKey, pose.session, last, read, refused), LinkRefusal::kSequence);
  EXPECT_EQ(refused.fault, Fault::kNone);
}

}  // namespace
}  // namespace trocar
