// SPDX-License-Identifier: Apache-2.0
// A drive behind the device link that states the pose of a handle and takes a wrench, as a PoseDevice. A state with a
// fault gives kMotorFault, and restore() acts after it as after kLinkLost.
#pragma once

#include <memory>

#include "runtime/link/udp_link.h"

namespace trocar::runtime {

class UdpPoseDevice final : public UdpLink<PoseDrive> {
 public:
  /// Opens the socket. No packet is sent before start(). Errors: (device fault) the socket
  /// cannot be opened.
  static Result<std::unique_ptr<UdpPoseDevice>> make(const UdpDeviceOptions& options) {
    Result<UdpSocket> socket = open_link_socket(options);
    if (!socket) return socket.error();
    return std::unique_ptr<UdpPoseDevice>(new UdpPoseDevice(options, std::move(*socket)));
  }

 private:
  using UdpLink::UdpLink;
};

}  // namespace trocar::runtime
