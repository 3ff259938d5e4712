// SPDX-License-Identifier: Apache-2.0
// What the host observes while it tries to reach a drive, and the message that says
// why the attempt failed.
// Tests: tests/runtime/link/udp_device_test.cpp, tests/runtime/link/udp_pose_device_test.cpp
#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "formats/session/device_protocol.h"

namespace trocar::runtime {

struct LinkAttempt {
  LinkNonce nonce{};  ///< nonce of the host's hello, the first packet of the handshake
  bool welcomed = false, wrong_key = false, busy = false, other_kind = false;
  bool other_program = false, other_version = false;
  /// Reason for refusing the last packet after the welcome; kNone: it was accepted, or none came.
  LinkRefusal state_refusal = LinkRefusal::kNone;

  /// Evaluates a datagram other than a welcome. (A welcome is the drive's positive answer
  /// to a hello.)
  void note(std::span<const std::uint8_t> datagram) noexcept;
  /// Returns the reason why the attempt failed. `socket_error`: UdpSocket::error(). `wanted`: the
  /// contents of states that the hello requested.
  std::string why(int socket_error, LinkContents wanted) const;
};

}  // namespace trocar::runtime
