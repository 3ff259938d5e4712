// SPDX-License-Identifier: Apache-2.0
// A PoseDevice that exchanges data with a drive over the device link (udp_link.h). The drive
// reports the pose of a handle, and takes a wrench. If the drive reports a fault, read() returns
// kMotorFault. After kMotorFault, as after kLinkLost, restore() requests a new session of the link.
#pragma once

#include <cstdint>
#include <memory>

#include "runtime/link/udp_link.h"

namespace trocar::runtime {

class UdpPoseDevice final : public UdpLink<PoseDrive> {
 public:
  /// Opens the socket. No packet is sent before start(). Errors: those of open_link_socket().
  static Result<std::unique_ptr<UdpPoseDevice>> make(const UdpLinkOptions& options) {
    Result<UdpSocket> socket = open_link_socket(options);
    if (!socket) return socket.error();
    return std::unique_ptr<UdpPoseDevice>(new UdpPoseDevice(options, std::move(*socket)));
  }
  std::uint8_t fault_byte() const noexcept override { return newest().faults; }

 private:
  using UdpLink::UdpLink;
};

}  // namespace trocar::runtime
