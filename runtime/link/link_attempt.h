// SPDX-License-Identifier: Apache-2.0
// Records what a host observes while it tries to reach a drive. If the attempt fails, the record
// gives the message that says why.
// Tests: tests/runtime/link/udp_device_test.cpp, tests/runtime/link/udp_pose_device_test.cpp
#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "formats/session/device_protocol.h"

namespace trocar::runtime {

struct LinkAttempt {
  LinkNonce nonce{};  ///< nonce of the host's hello, the first packet of the handshake
  // Each flag says whether one kind of answer has arrived. welcomed: the drive accepted the hello.
  // wrong_key, busy, other_kind: the drive denied the hello, because the keys differ, because it
  // serves another host, or because the host wanted angles and the drive has poses (or conversely).
  // other_program, other_version: the answer is not of the protocol, or of another version of it.
  bool welcomed = false, wrong_key = false, busy = false, other_kind = false;
  bool other_program = false, other_version = false;
  /// Why the last packet after the welcome was refused. kNone: that packet was accepted, or there
  /// was no such packet.
  LinkRefusal state_refusal = LinkRefusal::kNone;

  /// Sets the flags for a datagram other than a welcome. (The caller itself evaluates a welcome and
  /// sets `welcomed`.)
  void note(std::span<const std::uint8_t> datagram) noexcept;
  /// Returns the reason why the attempt failed. `socket_error`: UdpSocket::error(). `wanted`: what
  /// the hello requested, angles or poses.
  std::string why(int socket_error, LinkContents wanted) const;
};

}  // namespace trocar::runtime
