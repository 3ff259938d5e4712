// SPDX-License-Identifier: GPL-3.0-or-later
// One datagram of the device link, given to every reader. The fuzzer does not have the key: only
// the packets of the corpus (made with it) may be accepted, and encoding them again gives the same
// bytes.
#include <algorithm>
#include <cstdlib>
#include <type_traits>
#include <vector>

#include "formats/session/device_protocol.h"
#include "tests/fuzz/harness.h"

namespace {

using namespace trocar;  // NOLINT(google-build-using-namespace): a program of one file
using Bytes = std::vector<std::uint8_t>;

LinkKey shared_key() {
  static const LinkKey made = [] {
    if (!start_link()) std::abort();
    LinkKey k;
    for (std::size_t i = 0; i < k.bytes.size(); ++i)
      k.bytes[i] = static_cast<std::uint8_t>(7 * i + 1);
    return k;
  }();
  return made;
}
constexpr LinkNonce kHost = {1, 2, 3}, kDrive = {4, 5, 6};

template <typename Packet>
const LinkKey& key_for() {
  static const LinkKey shared = shared_key();
  static const LinkKey of_session = session_key(shared, kHost, kDrive);
  return std::is_same_v<Packet, HelloPacket> || std::is_same_v<Packet, WelcomePacket> ? shared
                                                                                      : of_session;
}

template <typename Packet>
Bytes encoded(const Packet& packet) {
  Bytes bytes(kMaxPacketBytes);
  bytes.resize(encode(packet, key_for<Packet>(), bytes));
  return bytes;
}

/// The packets of the corpus, which tests/fuzz/make_corpus.py makes independently.
const std::vector<Bytes>& valid_packets() {
  static const std::vector<Bytes> made = [] {
    const std::uint64_t session = session_number(kDrive);
    HelloPacket hello{1000, kHost, 1e-3, true};
    WelcomePacket welcome{2000, kHost, kDrive, 2.5e-4, LinkClock::kReal};
    CommandPacket command{session, 1, 3000, CommandMode::kTorque, 1, {}};
    StatePacket state{session, 1, 4000, DriveMode::kTorque, 0, 1, {}};
    for (std::size_t i = 0; i < kLinkMotors; ++i)
      command.tau_motor_Nm[i] = 0.25 * static_cast<double>(i) - 1;
    for (std::size_t i = 0; i < kLinkEncoders; ++i)
      state.encoder_rad[i] = 0.125 * static_cast<double>(i) - 1;
    HelloPacket hello_pose = hello;
    hello_pose.contents = LinkContents::kPose;
    WrenchCommandPacket wrench{session, 1, 3000, CommandMode::kTorque, 1, {}, {}};
    PoseStatePacket pose{session, 1, 4000, DriveMode::kTorque, 0, 6, 1, {}, {0.6, -0.8, 0, 0}};
    for (std::size_t i = 0; i < 3; ++i) {
      wrench.force_N[i] = command.tau_motor_Nm[i];
      wrench.moment_Nm[i] = command.tau_motor_Nm[i + 3];
      pose.p_m[i] = state.encoder_rad[i];
    }
    return std::vector<Bytes>{encoded(hello), encoded(welcome), encoded(command),
                              encoded(state), encoded(wrench),  encoded(hello_pose),
                              encoded(pose)};
  }();
  return made;
}

template <typename Packet>
void check(LinkRefusal refusal, const Packet& packet, const Bytes& bytes) {
  if (refusal != LinkRefusal::kNone) {
    if (!(packet == Packet{})) std::abort();  // a refused packet changes nothing
    return;
  }
  if (encoded(packet) != bytes) std::abort();
  const auto& known = valid_packets();
  if (std::find(known.begin(), known.end(), bytes) == known.end()) std::abort();
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const Bytes bytes(data, data + size);
  const std::uint64_t session = session_number(kDrive);
  valid_packets();
  HelloPacket hello;
  check(decode(bytes, key_for<HelloPacket>(), hello), hello, bytes);
  WelcomePacket welcome;
  check(decode(bytes, key_for<WelcomePacket>(), kHost, welcome), welcome, bytes);
  CommandPacket command;
  std::uint64_t last = 0;
  check(decode(bytes, key_for<CommandPacket>(), session, last, command), command, bytes);
  StatePacket state;
  last = 0;
  check(decode(bytes, key_for<StatePacket>(), session, last, state), state, bytes);
  WrenchCommandPacket wrench;
  last = 0;
  check(decode(bytes, key_for<WrenchCommandPacket>(), session, last, wrench), wrench, bytes);
  PoseStatePacket pose;
  last = 0;
  check(decode(bytes, key_for<PoseStatePacket>(), session, last, pose), pose, bytes);
  DenialPacket denial;  // anyone can make one
  Bytes again(kDenialBytes);
  const bool denied = decode(bytes, kHost, denial) == LinkRefusal::kNone;
  if (denied ? encode(denial, again) == 0 || again != bytes : !(denial == DenialPacket{}))
    std::abort();
  LinkNonce nonce{};
  if (!hello_nonce(bytes, nonce) && nonce != LinkNonce{}) std::abort();
  return 0;
}
