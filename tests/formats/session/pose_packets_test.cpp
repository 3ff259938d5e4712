// SPDX-License-Identifier: Apache-2.0
// The device link's packets for devices that measure their own pose: wrench commands and pose states. What they share
// with the other packets, and mutated packets of all kinds, are in device_protocol_test.cpp.
#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <fstream>
#include <iterator>
#include <limits>

#include "formats/session/device_protocol.h"
#include "tests/formats/session/link_packets.h"

namespace trocar {
namespace {

using namespace link_packets;  // NOLINT(google-build-using-namespace): of this test's folder

Page page_of(const WrenchCommandPacket& c) {
  Page page;
  page.header(6, 128, c.session, c.sequence, c.time_ns)
      .number(static_cast<std::uint64_t>(c.mode), 8)
      .number(c.state_seen, 8);
  for (const double each : c.force_N)
    page.real(each);
  for (const double each : c.moment_Nm)
    page.real(each);
  return page;
}
Page page_of(const PoseStatePacket& s) {
  Page page;
  page.header(7, 136, s.session, s.sequence, s.time_ns)
      .number(static_cast<std::uint64_t>(s.mode), 1)
      .number(s.faults, 3)
      .number(s.buttons, 4)
      .number(s.command_taken, 8);
  for (const double each : s.p_m)
    page.real(each);
  for (const double each : s.q)
    page.real(each);
  return page;
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
  const LinkRefusal refusal = refusal_of<Packet>(page_of(packet));
  EXPECT_EQ(encoded(packet).empty(), refusal != LinkRefusal::kNone)
      << "encode and decode disagree on the contents";
  return refusal;
}

class PosePackets : public testing::Test {
 protected:
  void SetUp() override { ASSERT_TRUE(start_link()); }
};

TEST_F(PosePackets, TheBytesAreThoseOfTheDocumentation) {
  EXPECT_EQ(encoded(wrench_command()), page_of(wrench_command()).sealed());
  EXPECT_EQ(encoded(pose_state()), page_of(pose_state()).sealed());
  EXPECT_EQ(encoded(wrench_command()).size(), 128U);
  EXPECT_EQ(encoded(pose_state()).size(), 136U);
  EXPECT_EQ(claimed_kind(encoded(wrench_command())), PacketKind::kWrenchCommand);
  EXPECT_EQ(claimed_kind(encoded(pose_state())), PacketKind::kPoseState);
}

TEST_F(PosePackets, ThePageHasTheirBytes) {
  const VectorsOfThePage page;
  const LinkKey key = page.key("session key");
  const WrenchCommandPacket sent{page.whole("wrench command", "session"),
                                 page.whole("wrench command", "sequence"),
                                 page.time_ns("wrench command"),
                                 static_cast<CommandMode>(page.whole("wrench command", "mode")),
                                 page.whole("wrench command", "newest state"),
                                 page.reals<3>("wrench command", "force"),
                                 page.reals<3>("wrench command", "moment")};
  EXPECT_EQ(encoded(sent, key), page.bytes("wrench command"));
  WrenchCommandPacket command_read;
  std::uint64_t last = 0;
  EXPECT_EQ(decode(page.bytes("wrench command"), key, sent.session, last, command_read),
            LinkRefusal::kNone);
  EXPECT_EQ(command_read, sent);
  const PoseStatePacket told{page.whole("pose state", "session"),
                             page.whole("pose state", "sequence"),
                             page.time_ns("pose state"),
                             static_cast<DriveMode>(page.whole("pose state", "mode")),
                             static_cast<std::uint8_t>(page.whole("pose state", "fault")),
                             static_cast<std::uint32_t>(page.whole("pose state", "buttons")),
                             page.whole("pose state", "newest command"),
                             page.reals<3>("pose state", "position"),
                             page.reals<4>("pose state", "orientation")};
  EXPECT_EQ(encoded(told, key), page.bytes("pose state"));
  PoseStatePacket state_read;
  last = 0;
  EXPECT_EQ(decode(page.bytes("pose state"), key, told.session, last, state_read),
            LinkRefusal::kNone);
  EXPECT_EQ(state_read, told);
}

TEST_F(PosePackets, DecodeGivesWhatWasEncoded) {
  const auto round_trip = [](const auto& packet) {
    std::decay_t<decltype(packet)> read;
    ASSERT_EQ(open(encoded(packet), read), LinkRefusal::kNone);
    EXPECT_EQ(read, packet);
  };
  round_trip(wrench_command());
  round_trip(pose_state());
  WrenchCommandPacket largest = wrench_command(std::numeric_limits<std::uint64_t>::max());
  largest.force_N = {kLinkMaxForce_N, -kLinkMaxForce_N, 5e-324};
  largest.moment_Nm = {-kLinkMaxMoment_Nm, kLinkMaxMoment_Nm, -0.0};
  round_trip(largest);
  PoseStatePacket farthest = pose_state();
  farthest.p_m = {kLinkMaxPosition_m, -kLinkMaxPosition_m, -0.0};
  farthest.q = {0, 0, 0, -1};
  round_trip(farthest);
}

TEST_F(PosePackets, EveryFlippedBitAndEveryLengthIsRefused) {
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
    for (std::size_t size = 0; size <= good.size() + 100; ++size) {
      if (size == good.size()) continue;
      Bytes bad = good;
      bad.resize(size);
      Packet read{};
      ASSERT_NE(open(bad, read), LinkRefusal::kNone) << "length " << size;
    }
  };
  check(wrench_command());
  check(pose_state());
}

TEST_F(PosePackets, RepeatedOvertakenAndOtherPacketsAreRefused) {
  std::uint64_t last = 0;
  PoseStatePacket read;
  const auto give = [&](std::uint64_t sequence) {
    return decode(encoded(pose_state(sequence)), kKey, pose_state().session, last, read);
  };
  EXPECT_EQ(give(5), LinkRefusal::kNone);
  EXPECT_EQ(give(5), LinkRefusal::kSequence);
  EXPECT_EQ(give(4), LinkRefusal::kSequence);
  EXPECT_EQ(give(900), LinkRefusal::kNone) << "gaps are losses, not attacks";
  const std::uint64_t session = pose_state().session;
  EXPECT_EQ(decode(encoded(pose_state(901)), kKey, session + 1, last, read), LinkRefusal::kSession);
  EXPECT_EQ(decode(encoded(pose_state(901), counted_key(2)), kKey, session, last, read),
            LinkRefusal::kMac);
  EXPECT_EQ(decode(encoded(wrench_command(901)), kKey, session, last, read), LinkRefusal::kKind);
  EXPECT_EQ(decode(encoded(state(901)), kKey, session, last, read), LinkRefusal::kKind);
  WrenchCommandPacket wrench;
  EXPECT_EQ(decode(encoded(command(901)), kKey, session, last, wrench), LinkRefusal::kKind);
  EXPECT_EQ(read.sequence, 900U);
  EXPECT_EQ(last, 900U);
}

TEST_F(PosePackets, InvalidNumbersAreRefused) {
  const double bad_numbers[] = {std::nan(""), -std::nan(""),
                                std::numeric_limits<double>::infinity(), 1000.1, -1e300};
  for (const double bad : bad_numbers) {
    for (std::size_t i = 0; i < 3; ++i) {
      WrenchCommandPacket force = wrench_command(), moment = wrench_command();
      force.force_N[i] = moment.moment_Nm[i] = bad;
      EXPECT_EQ(refusal_of(force), LinkRefusal::kContents);
      EXPECT_EQ(refusal_of(moment), LinkRefusal::kContents);
      PoseStatePacket pose = pose_state();
      pose.p_m[i] = bad;
      EXPECT_EQ(refusal_of(pose), LinkRefusal::kContents);
      pose.p_m[i] = 10.1;
      EXPECT_EQ(refusal_of(pose), LinkRefusal::kContents);
    }
    for (std::size_t i = 0; i < 4; ++i) {
      PoseStatePacket pose = pose_state();
      pose.q[i] = bad;
      EXPECT_EQ(refusal_of(pose), LinkRefusal::kContents);
    }
  }
  // The norm of the quaternion.
  for (const double norm : {0.0, 0.5, 0.9989, 1.0011, 2.0, 1e200}) {
    PoseStatePacket pose = pose_state();
    pose.q = {0.6 * norm, 0, -0.8 * norm, 0};
    EXPECT_EQ(refusal_of(pose), LinkRefusal::kContents) << norm;
  }
  for (const double norm : {0.9991, 1.0, 1.0009}) {
    PoseStatePacket pose = pose_state();
    pose.q = {0.6 * norm, 0, -0.8 * norm, 0};
    EXPECT_EQ(refusal_of(pose), LinkRefusal::kNone) << norm;
  }
}

// What an operator reads of a state that was refused.
TEST_F(PosePackets, ARefusalNamesTheField) {
  const double nan = std::nan("");
  const auto told = [](auto packet, std::size_t byte = 0) {
    Page page = page_of(packet);
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
  const auto good = page_of(pose_state()).sealed();
  EXPECT_EQ(decode(good, kKey, pose.session, last, read, refused), LinkRefusal::kNone);
  EXPECT_EQ(decode(good, kKey, pose.session, last, read, refused), LinkRefusal::kSequence);
  EXPECT_EQ(refused.fault, Fault::kNone);
}

TEST_F(PosePackets, InvalidModesAndBytesAreRefused) {
  for (int mode = 0; mode < 256; ++mode) {
    WrenchCommandPacket c = wrench_command();
    c.mode = static_cast<CommandMode>(mode);
    EXPECT_EQ(refusal_of(c) == LinkRefusal::kNone, mode == 2) << "hold and stop carry no wrench";
    c.force_N = {};
    EXPECT_EQ(refusal_of(c) == LinkRefusal::kNone, mode == 2) << "nor a moment alone";
    c.moment_Nm = {};
    EXPECT_EQ(refusal_of(c) == LinkRefusal::kNone, mode >= 1 && mode <= 3);
    PoseStatePacket s = pose_state();
    s.mode = static_cast<DriveMode>(mode);
    EXPECT_EQ(refusal_of(s) == LinkRefusal::kNone, mode >= 1 && mode <= 4);
    s = pose_state();
    s.faults = static_cast<std::uint8_t>(mode);
    EXPECT_EQ(refusal_of(s), LinkRefusal::kNone);
  }
  for (std::size_t at = 33; at < 40; ++at) {
    Page page = page_of(wrench_command());
    page.bytes[at] = 1;
    EXPECT_EQ(refusal_of<WrenchCommandPacket>(page), LinkRefusal::kContents) << at;
  }
  for (std::size_t at = 34; at < 36; ++at) {
    Page page = page_of(pose_state());
    page.bytes[at] = 1;
    EXPECT_EQ(refusal_of<PoseStatePacket>(page), LinkRefusal::kContents) << at;
  }
  EXPECT_EQ(refusal_of<WrenchCommandPacket>(page_of(wrench_command(0))), LinkRefusal::kSequence);
  EXPECT_EQ(refusal_of<PoseStatePacket>(page_of(pose_state(0))), LinkRefusal::kSequence);
}

// A hello for drives with angles has the bytes that it had before there were others.
TEST_F(PosePackets, AHelloNamesTheContents) {
  HelloPacket asked = hello(), read;
  EXPECT_EQ(encoded(asked)[57], 0);
  asked.contents = LinkContents::kPose;
  const Bytes bytes = encoded(asked);
  EXPECT_EQ(bytes[57], 1);
  const VectorsOfThePage page;
  const HelloPacket on_page{page.time_ns("hello for poses"),
                            page.nonce("hello for poses", "host's nonce"),
                            page.reals<1>("hello for poses", "period")[0], true,
                            static_cast<LinkContents>(page.whole("hello for poses", "contents"))};
  EXPECT_EQ(encoded(on_page, page.key("key")), page.bytes("hello for poses"));
  EXPECT_EQ(open(bytes, read), LinkRefusal::kNone);
  EXPECT_EQ(read, asked);
  asked.contents = static_cast<LinkContents>(2);
  EXPECT_TRUE(encoded(asked).empty());
  Page unknown;
  unknown.header(1, 96, 0, 1, 0).raw(asked.host_nonce).real(1e-3).number(1, 1).number(2, 7);
  HelloPacket nothing;
  EXPECT_EQ(open(unknown.sealed(), nothing), LinkRefusal::kContents);
  EXPECT_EQ(nothing, HelloPacket{});
}

// The corpus was made from device_link.md by a Python program.
TEST_F(PosePackets, PacketsOfAnotherImplementationAreAccepted) {
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
  EXPECT_EQ(decode(file("hello_pose"), shared, h), LinkRefusal::kNone);
  EXPECT_EQ(h, (HelloPacket{1000, host, 1e-3, true, LinkContents::kPose}));
  std::uint64_t last = 0;
  WrenchCommandPacket c;
  EXPECT_EQ(decode(file("wrench_command"), key, session_number(drive), last, c),
            LinkRefusal::kNone);
  EXPECT_EQ(c.force_N[2], -0.5);
  EXPECT_EQ(c.moment_Nm[2], 0.25);
  PoseStatePacket s;
  last = 0;
  EXPECT_EQ(decode(file("pose_state"), key, session_number(drive), last, s), LinkRefusal::kNone);
  EXPECT_EQ(s.buttons, 6U);
  EXPECT_EQ(s.q[1], -0.8);
  EXPECT_EQ(encoded(s, key), file("pose_state"));
}

}  // namespace
}  // namespace trocar
