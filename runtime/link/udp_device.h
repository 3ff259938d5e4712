// SPDX-License-Identifier: Apache-2.0
// A Device that exchanges angles and torques with the four-legged device's drive over
// the device link (udp_link.h).
#pragma once

#include <cstdint>
#include <memory>

#include "runtime/link/udp_link.h"

namespace trocar::runtime {

class UdpDevice final : public UdpLink<AngleDrive> {
 public:
  /// Opens the socket. No packet is sent before start(). Errors: those of open_link_socket().
  static Result<std::unique_ptr<UdpDevice>> make(const UdpLinkOptions& options) {
    Result<UdpSocket> socket = open_link_socket(options);
    if (!socket) return socket.error();
    return std::unique_ptr<UdpDevice>(new UdpDevice(options, std::move(*socket)));
  }
  std::uint8_t motor_faults() const noexcept override { return newest().motor_faults; }

 private:
  using UdpLink::UdpLink;
};

}  // namespace trocar::runtime
