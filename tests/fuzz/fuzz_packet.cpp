// SPDX-License-Identifier: GPL-3.0-or-later
// One datagram of the device link, given to every reader. The fuzzer does not have the key: only
// the packets of the corpus (made with it) may be accepted, and encoding them again gives the same
// bytes.
#include <algorithm>
#include <cstdlib>
#include <tuple>
#include <vector>

#include "formats/session/device_protocol.h"
#include "tests/fuzz/harness.h"
#include "tests/support/link_corpus.h"

namespace {

using namespace trocar;  // NOLINT(google-build-using-namespace): a program of one file
using Bytes = std::vector<std::uint8_t>;

template <typename Packet>
const LinkKey& key_for() {
  static const LinkKey key = [] {
    if (!start_link()) std::abort();
    return link_corpus::key_for<Packet>();
  }();
  return key;
}

template <typename Packet>
Bytes encoded(const Packet& packet) {
  Bytes bytes(kMaxPacketBytes);
  bytes.resize(encode(packet, key_for<Packet>(), bytes));
  return bytes;
}

const std::vector<Bytes>& valid_packets() {
  static const std::vector<Bytes> made = [] {
    std::vector<Bytes> all = {encoded(link_corpus::hello_for_poses())};
    std::apply([&](const auto&... packet) { (all.push_back(encoded(packet)), ...); },
               link_corpus::packets());
    return all;
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
  const std::uint64_t session = session_number(link_corpus::kDrive);
  valid_packets();
  HelloPacket hello;
  check(decode(bytes, key_for<HelloPacket>(), hello), hello, bytes);
  WelcomePacket welcome;
  check(decode(bytes, key_for<WelcomePacket>(), link_corpus::kHost, welcome), welcome, bytes);
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
  const bool denied = decode(bytes, link_corpus::kHost, denial) == LinkRefusal::kNone;
  if (denied ? encode(denial, again) == 0 || again != bytes : !(denial == DenialPacket{}))
    std::abort();
  LinkNonce nonce{};
  if (!hello_nonce(bytes, nonce) && nonce != LinkNonce{}) std::abort();
  return 0;
}
