// SPDX-License-Identifier: Apache-2.0
// The connection to a Haply Inverse3, a desktop haptic device. The maker's program, the Haply
// Inverse service (versions 3.1 and 3.5), drives the device and exchanges messages with this class
// through a WebSocket. An exchange sends a message with a force, and the service answers with the
// state of the devices (haply_messages.h). The haptic thread must not call these functions, because
// they block. The class has no thread of its own. Its asynchronous operations run only within
// open(), exchange() and close(). Each operation has a time limit, so that these functions return.
#pragma once

#include <array>
#include <chrono>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "formats/base/result.h"
#include "runtime/connection/haply_messages.h"
#include "runtime/connection/pose_connection.h"
#include "runtime/link/udp_socket.h"

namespace trocar::runtime {

/// The address of the service. `host` is the host's name as the user gave it, for messages;
/// `endpoint` is the resolved address with the port.
struct HaplyAddress {
  std::string host = "localhost";
  Endpoint endpoint{0x7f000001, 10001};
};

/// Parses what follows "haply:" in a URI: [HOST[:PORT]], by default localhost:10001. Resolves HOST
/// to an IPv4 address. Errors: kUsage if the text has another form or HOST is unknown. The message
/// is one line that begins with the URI.
Result<HaplyAddress> parse_haply_address(std::string_view text);

struct HaplyOptions {
  HaplyAddress address;
  SayLine say;  ///< receives lines about devices that were found, or for which open() waits
  /// True: open() fails without a VerseGrip, a handle that measures its orientation. False: a
  /// VerseGrip is used only if it is ready when open() first finds an arm that is ready.
  bool wants_rotation = false;
  double open_timeout_s = kOpenTimeout_s;
};

/// A reading's position is that of the cursor, the point that the Inverse3 measures, in the
/// service's application space (haply_messages.h). A reading's orientation and buttons are those of
/// a VerseGrip. The force acts on the cursor. Moments are not rendered.
class HaplyConnection final : public PoseConnection {
 public:
  explicit HaplyConnection(HaplyOptions options);
  /// Calls close().
  ~HaplyConnection() override;
  HaplyConnection(const HaplyConnection&) = delete;
  HaplyConnection& operator=(const HaplyConnection&) = delete;

  /// Chooses the first arm (an Inverse3) of the service's list, and the first grip (a VerseGrip)
  /// that is ready. Waits at most open_timeout_s until the chosen devices are ready. If no grip is
  /// ready and wants_rotation is false, open() continues without a grip. A later call chooses the
  /// same devices again.
  Result<void> open() override;
  /// If the service's answer is unusable (HaplyAnswer), the force is sent again immediately.
  /// Errors, in addition to those of PoseConnection::exchange(): five unusable answers in a row;
  /// the arm or the grip is no longer ready; the force is not finite.
  Result<PoseReading> exchange(const HandleWrench& wrench) override;
  FaultDetail refused_contents() const noexcept override { return refused_; }
  void close() noexcept override;

  /// After open(): true if readings have a measured orientation.
  bool senses_rotation() const { return devices_ && devices_->grip; }

 private:
  struct Socket;
  using Instant = std::chrono::steady_clock::time_point;
  Error fault(const std::string& why) const;
  void say(const std::string& line) const;
  Result<void> connect(Instant until);
  /// Waits for an inventory (the service's list of its devices) in which the chosen
  /// devices are ready.
  Result<HaplyDevices> find_devices(Instant until);
  /// Chooses the devices. Returns the reason why they cannot be used yet; empty: they can be used.
  std::string choose(const HaplyInventory& inventory, HaplyDevices& chosen) const;
  /// Passes lines about the devices to HaplyOptions::say, such as their ids and unusual settings.
  void describe(const HaplyInventory& inventory, const HaplyDevices& chosen) const;
  Result<PoseReading> command(const HaplyDevices& devices, const std::array<double, 3>& force_N);

  HaplyOptions options_;
  std::string uri_;                      ///< the device's URI, with which each error begins
  std::optional<HaplyDevices> devices_;  ///< devices that the first open() chose
  std::unique_ptr<Socket> socket_;
  FaultDetail refused_;  ///< of the last exchange()
};

}  // namespace trocar::runtime
