// SPDX-License-Identifier: Apache-2.0
// For tests of the device link's packets: packets, their bytes according to device_link.md (written here
// a second time, with libsodium alone), and the test vectors of that page.
#pragma once

#include <gtest/gtest.h>
#include <sodium.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <iterator>
#include <sstream>
#include <string>
#include <vector>

#include "formats/session/device_protocol.h"

namespace trocar::link_packets {

using Bytes = std::vector<std::uint8_t>;

inline LinkKey counted_key(std::uint8_t first) {
  LinkKey key;
  for (std::size_t i = 0; i < key.bytes.size(); ++i)
    key.bytes[i] = static_cast<std::uint8_t>(first + i);
  return key;
}

inline const LinkKey kKey = counted_key(1);

inline HelloPacket hello() {
  HelloPacket packet;
  packet.time_ns = -5;
  packet.host_nonce = {9, 8, 7};
  packet.period_s = 1e-3;
  return packet;
}
inline WelcomePacket welcome() {
  return {77, {9, 8, 7}, {1, 2, 3, 4, 5, 6, 7, 8, 9}, 2.5e-4, LinkClock::kLockStep};
}
inline CommandPacket command(std::uint64_t sequence = 3) {
  CommandPacket packet{0x0807060504030201, sequence, 123456789012345, CommandMode::kTorque, 41, {}};
  for (std::size_t i = 0; i < kLinkMotors; ++i)
    packet.tau_motor_Nm[i] = 0.1 * static_cast<double>(i) - 0.35;
  return packet;
}
inline StatePacket state(std::uint64_t sequence = 4) {
  StatePacket packet{0x0807060504030201, sequence, -1, DriveMode::kWatchdog, 0x81, 3, {}};
  for (std::size_t i = 0; i < kLinkEncoders; ++i)
    packet.encoder_rad[i] = std::sin(static_cast<double>(i));
  return packet;
}

inline WrenchCommandPacket wrench_command(std::uint64_t sequence = 3) {
  return {0x0807060504030201,   sequence,          123456789012345, CommandMode::kTorque, 41,
          {1.25, -0.5, 999.75}, {0.1, -1000, 1e-9}};
}
inline PoseStatePacket pose_state(std::uint64_t sequence = 4) {
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

inline LinkRefusal open(const Bytes& bytes, HelloPacket& packet) {
  return decode(bytes, kKey, packet);
}
inline LinkRefusal open(const Bytes& bytes, WelcomePacket& packet) {
  return decode(bytes, kKey, hello().host_nonce, packet);
}
inline LinkRefusal open(const Bytes& bytes, CommandPacket& packet) {
  std::uint64_t last = 0;
  return decode(bytes, kKey, command().session, last, packet);
}
inline LinkRefusal open(const Bytes& bytes, StatePacket& packet) {
  std::uint64_t last = 0;
  return decode(bytes, kKey, state().session, last, packet);
}
inline LinkRefusal open(const Bytes& bytes, WrenchCommandPacket& packet) {
  std::uint64_t last = 0;
  return decode(bytes, kKey, wrench_command().session, last, packet);
}
inline LinkRefusal open(const Bytes& bytes, PoseStatePacket& packet) {
  std::uint64_t last = 0;
  return decode(bytes, kKey, pose_state().session, last, packet);
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

/// The test vectors of device_link.md: blocks "```hex NAME" of bytes, and for each kind of packet a
/// table of fields.
class VectorsOfThePage {
 public:
  VectorsOfThePage() {
    std::ifstream file(TROCAR_LINK_PAGE);
    text_.assign(std::istreambuf_iterator<char>(file), {});
  }
  Bytes bytes(const std::string& name) const {
    std::istringstream in(between("```hex " + name + "\n", "```"));
    Bytes out;
    for (unsigned value = 0; in >> std::hex >> value;)
      out.push_back(static_cast<std::uint8_t>(value));
    return out;
  }
  LinkKey key(const std::string& name) const {
    LinkKey out;
    const Bytes all = bytes(name);
    EXPECT_EQ(all.size(), out.bytes.size()) << name;
    std::copy_n(all.begin(), std::min(all.size(), out.bytes.size()), out.bytes.begin());
    return out;
  }
  std::string field(const std::string& kind, const std::string& name) const {
    const std::string table = between("### " + kind + "\n", "```");
    const std::string row = "\n| " + name + " | ";
    const std::size_t at = table.find(row);
    EXPECT_NE(at, std::string::npos) << kind << ": " << name;
    if (at == std::string::npos) return {};
    const std::size_t from = at + row.size();
    return table.substr(from, table.find(" |", from) - from);
  }
  std::uint64_t whole(const std::string& kind, const std::string& name) const {
    return std::strtoull(field(kind, name).c_str(), nullptr, 10);
  }
  std::int64_t time_ns(const std::string& kind) const {
    return static_cast<std::int64_t>(whole(kind, "time"));
  }
  template <std::size_t N>
  std::array<double, N> reals(const std::string& kind, const std::string& name) const {
    std::istringstream in(field(kind, name));
    std::array<double, N> out{};
    std::string word;
    for (std::size_t i = 0; i < N && std::getline(in, word, ','); ++i)
      out[i] = std::strtod(word.c_str(), nullptr);
    return out;
  }
  LinkNonce nonce(const std::string& kind, const std::string& name) const {
    const std::string text = field(kind, name);  // `HEX`
    LinkNonce out{};
    for (std::size_t i = 0; i < out.size() && 2 * i + 3 < text.size(); ++i)
      out[i] = static_cast<std::uint8_t>(std::stoul(text.substr(2 * i + 1, 2), nullptr, 16));
    return out;
  }

 private:
  std::string between(const std::string& before, const std::string& after) const {
    const std::size_t at = text_.find(before);
    EXPECT_NE(at, std::string::npos) << before;
    if (at == std::string::npos) return {};
    const std::size_t from = at + before.size();
    return text_.substr(from, text_.find(after, from) - from);
  }
  std::string text_;
};

}  // namespace trocar::link_packets
