// SPDX-License-Identifier: Apache-2.0
// The device link's packets: their bytes are those of formats/session/device_link.md (written here
// a second time, with libsodium alone), and only unchanged, new packets are accepted.
#include "formats/session/device_protocol.h"

#include <gtest/gtest.h>
#include <sodium.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <iterator>
#include <limits>
#include <random>
#include <string>
#include <vector>

#include "tests/formats/session/link_packets.h"

namespace trocar {
namespace {

using namespace link_packets;  // NOLINT(google-build-using-namespace): of this test's folder

Page page_of(const CommandPacket& c) {
  Page page;
  page.header(3, 144, c.session, c.sequence, c.time_ns)
      .number(static_cast<std::uint64_t>(c.mode), 8)
      .number(c.state_seen, 8);
  for (const double tau : c.tau_motor_Nm)
    page.real(tau);
  return page;
}
Page page_of(const StatePacket& s) {
  Page page;
  page.header(4, 208, s.session, s.sequence, s.time_ns)
      .number(static_cast<std::uint64_t>(s.mode), 1)
      .number(s.motor_faults, 7)
      .number(s.command_taken, 8);
  for (const double angle : s.encoder_rad)
    page.real(angle);
  return page;
}
Page page_of(const HelloPacket& h) {
  Page page;
  page.header(1, 96, 0, 1, h.time_ns)
      .raw(h.host_nonce)
      .real(h.period_s)
      .number(h.resets_world ? 1 : 0, 8);
  return page;
}
Page page_of(const WelcomePacket& w) {
  Page page;
  page.header(2, 112, 0x0807060504030201, 1, w.time_ns)
      .raw(w.host_nonce)
      .raw(w.drive_nonce)
      .real(w.period_s)
      .number(static_cast<std::uint64_t>(w.clock), 8);
  return page;
}

class DeviceProtocol : public testing::Test {
 protected:
  void SetUp() override { ASSERT_TRUE(start_link()); }
};

TEST_F(DeviceProtocol, TheBytesAreThoseOfTheDocumentation) {
  EXPECT_EQ(encoded(hello()), page_of(hello()).sealed());
  EXPECT_EQ(encoded(welcome()), page_of(welcome()).sealed());
  EXPECT_EQ(encoded(command()), page_of(command()).sealed());
  EXPECT_EQ(encoded(state()), page_of(state()).sealed());
  EXPECT_EQ(encoded(hello()).size(), 96U);
  EXPECT_EQ(encoded(welcome()).size(), 112U);
  EXPECT_EQ(encoded(command()).size(), 144U);
  EXPECT_EQ(encoded(state()).size(), 208U);
  // The session key.
  Page text;
  for (const char c : std::string("trocar link 1"))
    text.number(static_cast<std::uint64_t>(c), 1);
  text.raw(welcome().host_nonce).raw(welcome().drive_nonce);
  const Bytes sealed = text.sealed();
  const LinkKey key = session_key(kKey, welcome().host_nonce, welcome().drive_nonce);
  EXPECT_TRUE(std::equal(key.bytes.begin(), key.bytes.end(), sealed.end() - 32));
  EXPECT_EQ(session_number(welcome().drive_nonce), 0x0807060504030201U);
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

TEST_F(DeviceProtocol, ThePageHasTheBytesOfHelloAndWelcome) {
  const VectorsOfThePage page;
  const LinkKey key = page.key("key");
  const HelloPacket asked{page.time_ns("hello"), page.nonce("hello", "host's nonce"),
                          page.reals<1>("hello", "period")[0],
                          page.whole("hello", "starts again") == 1};
  EXPECT_EQ(encoded(asked, key), page.bytes("hello"));
  HelloPacket hello_read;
  EXPECT_EQ(decode(page.bytes("hello"), key, hello_read), LinkRefusal::kNone);
  EXPECT_EQ(hello_read, asked);
  const WelcomePacket answer{page.time_ns("welcome"), asked.host_nonce,
                             page.nonce("welcome", "drive's nonce"),
                             page.reals<1>("welcome", "period")[0],
                             static_cast<LinkClock>(page.whole("welcome", "clock"))};
  EXPECT_EQ(encoded(answer, key), page.bytes("welcome"));
  WelcomePacket welcome_read;
  EXPECT_EQ(decode(page.bytes("welcome"), key, asked.host_nonce, welcome_read), LinkRefusal::kNone);
  EXPECT_EQ(welcome_read, answer);
  EXPECT_EQ(session_key(key, asked.host_nonce, answer.drive_nonce).bytes,
            page.key("session key").bytes);
  EXPECT_EQ(session_number(answer.drive_nonce), page.whole("command", "session"));
}

TEST_F(DeviceProtocol, ThePageHasTheBytesOfADenial) {
  const VectorsOfThePage page;
  const DenialPacket denial{page.time_ns("denial"), page.nonce("denial", "host's nonce"),
                            static_cast<DenialReason>(page.whole("denial", "reason"))};
  Bytes bytes(kDenialBytes);
  ASSERT_EQ(encode(denial, bytes), kDenialBytes);
  EXPECT_EQ(bytes, page.bytes("denial"));
  DenialPacket read;
  EXPECT_EQ(decode(page.bytes("denial"), denial.host_nonce, read), LinkRefusal::kNone);
  EXPECT_EQ(read, denial);
}

TEST_F(DeviceProtocol, ThePageHasTheBytesOfCommandAndState) {
  const VectorsOfThePage page;
  const LinkKey key = page.key("session key");
  const CommandPacket sent{page.whole("command", "session"),
                           page.whole("command", "sequence"),
                           page.time_ns("command"),
                           static_cast<CommandMode>(page.whole("command", "mode")),
                           page.whole("command", "newest state"),
                           page.reals<kLinkMotors>("command", "torques")};
  EXPECT_EQ(encoded(sent, key), page.bytes("command"));
  CommandPacket command_read;
  std::uint64_t last = 0;
  EXPECT_EQ(decode(page.bytes("command"), key, sent.session, last, command_read),
            LinkRefusal::kNone);
  EXPECT_EQ(command_read, sent);
  const StatePacket told{page.whole("state", "session"),
                         page.whole("state", "sequence"),
                         page.time_ns("state"),
                         static_cast<DriveMode>(page.whole("state", "mode")),
                         static_cast<std::uint8_t>(page.whole("state", "motor faults")),
                         page.whole("state", "newest command"),
                         page.reals<kLinkEncoders>("state", "angles")};
  EXPECT_EQ(encoded(told, key), page.bytes("state"));
  StatePacket state_read;
  last = 0;
  EXPECT_EQ(decode(page.bytes("state"), key, told.session, last, state_read), LinkRefusal::kNone);
  EXPECT_EQ(state_read, told);
}

template <typename Packet>
void expect_round_trip(const Packet& packet) {
  Packet read;
  ASSERT_EQ(open(encoded(packet), read), LinkRefusal::kNone);
  EXPECT_EQ(read, packet);
  EXPECT_EQ(encoded(read), encoded(packet));
}

TEST_F(DeviceProtocol, DecodeGivesWhatWasEncoded) {
  expect_round_trip(hello());
  expect_round_trip(welcome());
  expect_round_trip(command());
  expect_round_trip(state());
  CommandPacket extreme = command(std::numeric_limits<std::uint64_t>::max());
  extreme.tau_motor_Nm = {kLinkMaxTorque_Nm, -kLinkMaxTorque_Nm, 5e-324, -0.0, 1 / 3.0, 0, 0, 0};
  expect_round_trip(extreme);
}

TEST_F(DeviceProtocol, EveryFlippedBitAndEveryLengthIsRefusedAndChangesNothing) {
  const auto check = [](const auto& packet) {
    using Packet = std::decay_t<decltype(packet)>;
    const Bytes good = encoded(packet);
    for (std::size_t bit = 0; bit < 8 * good.size(); ++bit) {
      Bytes bad = good;
      bad[bit / 8] ^= static_cast<std::uint8_t>(1U << (bit % 8));
      Packet read{};
      ASSERT_NE(open(bad, read), LinkRefusal::kNone) << "bit " << bit;
      ASSERT_EQ(read, Packet{});
    }
    for (std::size_t size = 0; size <= good.size() + 40; ++size) {
      if (size == good.size()) continue;
      Bytes bad = good;
      bad.resize(size);
      Packet read{};
      ASSERT_NE(open(bad, read), LinkRefusal::kNone) << "length " << size;
    }
  };
  check(hello());
  check(welcome());
  check(command());
  check(state());
}

TEST_F(DeviceProtocol, RepeatedAndOvertakenPacketsAreRefused) {
  std::uint64_t last = 0;
  CommandPacket read;
  const auto give = [&](std::uint64_t sequence) {
    return decode(encoded(command(sequence)), kKey, command().session, last, read);
  };
  EXPECT_EQ(give(5), LinkRefusal::kNone);
  EXPECT_EQ(give(5), LinkRefusal::kSequence);
  EXPECT_EQ(give(4), LinkRefusal::kSequence);
  EXPECT_EQ(read.sequence, 5U);
  EXPECT_EQ(give(900), LinkRefusal::kNone) << "gaps are losses, not attacks";
  EXPECT_EQ(give(899), LinkRefusal::kSequence);
  // A forged packet with a high sequence does not block the authentic ones.
  Bytes forged = page_of(command(1000000)).sealed(counted_key(2));
  EXPECT_EQ(decode(forged, kKey, command().session, last, read), LinkRefusal::kMac);
  EXPECT_EQ(give(901), LinkRefusal::kNone);
}

TEST_F(DeviceProtocol, PacketsOfAnotherSessionDirectionOrKeyAreRefused) {
  std::uint64_t last = 0;
  CommandPacket read;
  StatePacket read_state;
  HelloPacket read_hello;
  const Bytes old = encoded(command());
  EXPECT_EQ(decode(old, kKey, command().session + 1, last, read), LinkRefusal::kSession);
  // The session number is right, but the key is still wrong.
  const LinkKey other = session_key(kKey, hello().host_nonce, {2});
  EXPECT_EQ(decode(old, other, command().session, last, read), LinkRefusal::kMac);
  EXPECT_EQ(decode(old, kKey, command().session, last, read_state), LinkRefusal::kKind);
  EXPECT_EQ(decode(encoded(state()), kKey, state().session, last, read), LinkRefusal::kKind);
  EXPECT_EQ(decode(encoded(welcome()), kKey, read_hello), LinkRefusal::kKind);
  WelcomePacket read_welcome;
  EXPECT_EQ(decode(encoded(welcome()), kKey, {1, 1, 1}, read_welcome), LinkRefusal::kContents)
      << "a welcome to another host's hello";
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
}

// Packets made with the right key are refused if their contents are invalid.
TEST_F(DeviceProtocol, AuthenticPacketsWithInvalidContentsAreRefused) {
  const double bad_numbers[] = {std::nan(""), -std::nan(""),
                                std::numeric_limits<double>::infinity(), 1000.1, -1e300};
  for (const double bad : bad_numbers) {
    for (std::size_t i = 0; i < kLinkMotors; ++i) {
      CommandPacket packet = command(), read{};
      packet.tau_motor_Nm[i] = bad;
      EXPECT_EQ(open(page_of(packet).sealed(), read), LinkRefusal::kContents);
      EXPECT_EQ(read, CommandPacket{});
      EXPECT_EQ(encoded(packet).size(), 0U);
    }
    for (std::size_t i = 0; i < kLinkEncoders; ++i) {
      StatePacket packet = state(), read{};
      packet.encoder_rad[i] = bad;
      EXPECT_EQ(open(page_of(packet).sealed(), read), LinkRefusal::kContents);
      EXPECT_EQ(encoded(packet).size(), 0U);
    }
    HelloPacket packet = hello(), read{};
    packet.period_s = bad;
    EXPECT_EQ(open(page_of(packet).sealed(), read), LinkRefusal::kContents);
  }
  for (int mode = 0; mode < 256; ++mode) {
    CommandPacket c = command(), read_command;
    c.mode = static_cast<CommandMode>(mode);
    EXPECT_EQ(open(page_of(c).sealed(), read_command) == LinkRefusal::kNone, mode == 2)
        << "hold and stop must not carry torques";
    c.tau_motor_Nm = {};
    EXPECT_EQ(open(page_of(c).sealed(), read_command) == LinkRefusal::kNone,
              mode >= 1 && mode <= 3);
    StatePacket s = state(), read_state;
    s.mode = static_cast<DriveMode>(mode);
    EXPECT_EQ(open(page_of(s).sealed(), read_state) == LinkRefusal::kNone, mode >= 1 && mode <= 4);
    WelcomePacket w = welcome(), read_welcome;
    w.clock = static_cast<LinkClock>(mode);
    EXPECT_EQ(open(page_of(w).sealed(), read_welcome) == LinkRefusal::kNone,
              mode == 1 || mode == 2);
  }
  // Bytes that must be zero.
  for (std::size_t at = 33; at < 40; ++at) {
    Page page = page_of(command());
    page.bytes[at] = 1;
    CommandPacket read;
    EXPECT_EQ(open(page.sealed(), read), LinkRefusal::kContents);
  }
  CommandPacket zero = command(0), read;
  EXPECT_EQ(open(page_of(zero).sealed(), read), LinkRefusal::kSequence);
}

TEST_F(DeviceProtocol, ARefusedStateNamesItsAngle) {
  StatePacket packet = state(), read;
  packet.encoder_rad[6] = std::nan("");
  std::uint64_t last = 0;
  FaultDetail refused;
  EXPECT_EQ(decode(page_of(packet).sealed(), kKey, packet.session, last, read, refused),
            LinkRefusal::kContents);
  EXPECT_EQ(refused.fault, Fault::kRefusedState);
  EXPECT_EQ(measured(refused), "angle theta 3 of leg 2 nan deg, limit 5.73e+04 deg");
}

// The corpus was made from device_link.md by a Python program.
TEST_F(DeviceProtocol, PacketsOfAnotherImplementationAreAccepted) {
  LinkKey shared;
  for (std::size_t i = 0; i < shared.bytes.size(); ++i)
    shared.bytes[i] = static_cast<std::uint8_t>(7 * i + 1);
  const LinkNonce host = {1, 2, 3}, drive = {4, 5, 6};
  const LinkKey key = session_key(shared, host, drive);
  const auto file = [](const std::string& name) {
    std::ifstream stream(TROCAR_CORPUS "/packet/" + name + ".bin", std::ios::binary);
    return Bytes(std::istreambuf_iterator<char>(stream), {});
  };
  HelloPacket h;
  EXPECT_EQ(decode(file("hello"), shared, h), LinkRefusal::kNone);
  EXPECT_EQ(h, (HelloPacket{1000, host, 1e-3, true}));
  WelcomePacket w;
  EXPECT_EQ(decode(file("welcome"), shared, host, w), LinkRefusal::kNone);
  EXPECT_EQ(w, (WelcomePacket{2000, host, drive, 2.5e-4, LinkClock::kReal}));
  std::uint64_t last = 0;
  CommandPacket c;
  EXPECT_EQ(decode(file("command"), key, session_number(drive), last, c), LinkRefusal::kNone);
  EXPECT_EQ(c.tau_motor_Nm[7], 0.75);
  StatePacket s;
  last = 0;
  EXPECT_EQ(decode(file("state"), key, session_number(drive), last, s), LinkRefusal::kNone);
  EXPECT_EQ(s.encoder_rad[15], 0.875);
  EXPECT_EQ(encoded(s, key), file("state"));
}

TEST_F(DeviceProtocol, ATooShortBufferIsNotWrittenTo) {
  Bytes small(kStateBytes - 1, 0xaa);
  EXPECT_EQ(encode(state(), kKey, small), 0U);
  EXPECT_EQ(small, Bytes(kStateBytes - 1, 0xaa));
}

// Random bytes and mutated packets are never accepted. TROCAR_PACKETS sets their number.
TEST_F(DeviceProtocol, RandomAndMutatedPacketsAreNeverAccepted) {
  const char* wanted = std::getenv("TROCAR_PACKETS");  // NOLINT(concurrency-mt-unsafe)
  const long packets = wanted != nullptr ? std::atol(wanted) : 1'000'000;
  std::mt19937_64 random(20);
  const auto below = [&](std::size_t n) { return static_cast<std::size_t>(random() % n); };
  const std::vector<Bytes> true_ones = {encoded(hello()),          encoded(welcome()),
                                        encoded(command()),        encoded(state()),
                                        encoded(wrench_command()), encoded(pose_state())};
  LinkCounts counts;
  for (long n = 0; n < packets; ++n) {
    Bytes bytes;
    if (n % 4 == 0) {
      bytes.resize(below(300));
      for (std::uint8_t& b : bytes)
        b = static_cast<std::uint8_t>(random());
      if (n % 8 == 0 && bytes.size() >= 8) {  // a plausible header
        std::copy_n(true_ones[below(true_ones.size())].begin(), 8, bytes.begin());
      }
    } else {
      bytes = true_ones[below(true_ones.size())];
      const Bytes before = bytes;
      for (std::size_t changes = 1 + below(4); changes > 0; --changes) {
        switch (below(5)) {
          case 0:
            bytes[below(bytes.size())] ^= static_cast<std::uint8_t>(1U << below(8));
            break;
          case 1:
            bytes[below(bytes.size())] = static_cast<std::uint8_t>(random());
            break;
          case 2: {  // a number
            const std::size_t at = 8 * below(bytes.size() / 8);
            const std::uint64_t value = below(2) == 0 ? random() : below(3);
            std::memcpy(&bytes[at], &value, 8);
            break;
          }
          case 3: {  // the tail of another packet: its MAC
            const Bytes& other = true_ones[below(true_ones.size())];
            std::copy(other.end() - 32, other.end(), bytes.end() - 32);
            break;
          }
          default:
            std::swap(bytes[below(bytes.size())], bytes[below(bytes.size())]);
        }
      }
      if (below(8) == 0) bytes.resize(32 + below(bytes.size() - 32));
      if (bytes == before) continue;
    }
    HelloPacket h;
    WelcomePacket w;
    CommandPacket c;
    StatePacket s;
    WrenchCommandPacket wrench;
    PoseStatePacket pose;
    for (const LinkRefusal refusal : {open(bytes, h), open(bytes, w), open(bytes, c),
                                      open(bytes, s), open(bytes, wrench), open(bytes, pose)}) {
      ASSERT_NE(refusal, LinkRefusal::kNone) << "packet " << n;
      counts.add(refusal);
    }
  }
  EXPECT_EQ(counts.accepted(), 0U);
  std::printf("%ld packets, by six readers each:", packets);
  for (std::size_t i = 1; i < kLinkRefusals; ++i) {
    std::printf(" %s %llu", to_string(static_cast<LinkRefusal>(i)),
                static_cast<unsigned long long>(counts.by_refusal[i]));
  }
  std::printf("\n");
  EXPECT_GT(counts.by_refusal[static_cast<std::size_t>(LinkRefusal::kMac)],
            100'000U * packets / 1'000'000);
}

}  // namespace
}  // namespace trocar
