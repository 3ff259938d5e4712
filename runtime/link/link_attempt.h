// SPDX-License-Identifier: Apache-2.0
// Records what a host observes while it tries to reach a drive. If the attempt fails, the record
// gives the message that says why.
#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "formats/session/device_protocol.h"

namespace trocar::runtime {

struct LinkAttempt {
  LinkNonce nonce{};  ///< nonce of the host's hello, the first packet of the handshake
  // Each flag says whether one kind of answer has arrived.
  //  - welcomed: the drive accepted the hello.
  //  - wrong_key: the drive denied the hello, because it has another key.
  //  - busy: the drive denied the hello, because it serves another host.
  //  - other_kind: the drive denied the hello. The host wanted angles and the drive has poses, or
  //    the host wanted poses and the drive has angles.
  //  - other_program: the answer does not come from a drive of the device link.
  //  - other_version: the answer is of another version of the protocol.
  bool welcomed = false, wrong_key = false, busy = false, other_kind = false;
  bool other_program = false, other_version = false;
  /// The reason for which the host refused the last packet after the welcome. kNone: the host
  /// accepted this packet, or no packet arrived after the welcome.
  LinkRefusal state_refusal = LinkRefusal::kNone;
  FaultDetail refused;  ///< if state_refusal is kContents: the field that was refused

  /// Sets the flags for a datagram other than a welcome. (The caller itself evaluates a welcome and
  /// sets `welcomed`.)
  void note(std::span<const std::uint8_t> datagram) noexcept;
  /// Returns the reason why the attempt failed. `socket_error`: UdpSocket::error(). `wanted`: what
  /// the hello requested, angles or poses.
  std::string why(int socket_error, LinkContents wanted) const;
};

}  // namespace trocar::runtime
