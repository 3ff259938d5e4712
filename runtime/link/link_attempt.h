// SPDX-License-Identifier: Apache-2.0
// Observations in an attempt to reach a drive, and the message that says why it failed.
// Tests: tests/runtime/link/udp_device_test.cpp, tests/runtime/link/udp_pose_device_test.cpp
#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "formats/session/device_protocol.h"

namespace trocar::runtime {

struct LinkAttempt {
  LinkNonce nonce{};  ///< the nonce in the hello
  bool welcomed = false, wrong_key = false, busy = false, other_kind = false;
  bool other_program = false, other_version = false;
  LinkRefusal state_refusal =
      LinkRefusal::kNone;  ///< why the last packet after the welcome was refused

  /// Evaluates a datagram that is not a welcome.
  void note(std::span<const std::uint8_t> datagram) noexcept;
  /// `socket_error`: UdpSocket::error(). `wanted`: the contents that the hello asked for.
  std::string why(int socket_error, LinkContents wanted) const;
};

}  // namespace trocar::runtime
