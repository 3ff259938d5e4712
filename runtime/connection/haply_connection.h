// SPDX-License-Identifier: Apache-2.0
// A Haply Inverse3 through the Haply Inverse service, versions 3.1 and 3.5. On a WebSocket, each message commands a force
// and is answered with one state (haply_messages.h). Not for the haptic thread. The class has no thread of its own. Its
// asynchronous operations run within open(), exchange() and close(), so that each of these functions ends in time.
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

struct HaplyAddress {
  std::string host = "localhost";
  Endpoint endpoint{0x7f000001, 10001};
};

/// Parses what follows "haply:" in a URI: [HOST[:PORT]], by default localhost:10001. Resolves HOST to an IPv4 address.
/// Errors: (usage) one line that begins with the URI.
Result<HaplyAddress> parse_haply_address(std::string_view text);

struct HaplyOptions {
  HaplyAddress address;
  SayLine say;                  ///< takes what is found, and what is waited for
  bool wants_rotation = false;  ///< without a VerseGrip, open() fails
  double open_timeout_s = kOpenTimeout_s;
};

/// The reading's position is that of the cursor, in the service's application space. Its orientation and its buttons are
/// those of the first usable VerseGrip. The force acts on the cursor. The moment is not rendered.
class HaplyConnection final : public PoseConnection {
 public:
  explicit HaplyConnection(HaplyOptions options);
  /// Calls close().
  ~HaplyConnection() override;
  HaplyConnection(const HaplyConnection&) = delete;
  HaplyConnection& operator=(const HaplyConnection&) = delete;

  /// Chooses the first arm, and the first grip that is ready. Waits until they are ready, at most open_timeout_s. A later
  /// call chooses the same devices again.
  Result<void> open() override;
  /// After an unusable answer the force is sent again at once. Errors, in addition to those of PoseConnection: five
  /// unusable answers one after the other; the arm or the grip is no longer ready; the force is not finite.
  Result<PoseReading> exchange(const HandleWrench& wrench) override;
  void close() noexcept override;

  /// After open(): true if readings have an orientation.
  bool senses_rotation() const { return devices_ && devices_->grip; }

 private:
  struct Socket;
  using Instant = std::chrono::steady_clock::time_point;
  Error fault(const std::string& why) const;
  void say(const std::string& line) const;
  Result<void> connect(Instant until);
  /// Waits for an inventory in which the devices are ready.
  Result<HaplyDevices> find_devices(Instant until);
  /// Chooses the devices. Returns the reason why they cannot be used yet; empty: they can be used.
  std::string choose(const HaplyInventory& inventory, HaplyDevices& chosen) const;
  /// Reports what the user should know about the devices.
  void describe(const HaplyInventory& inventory, const HaplyDevices& chosen) const;
  Result<PoseReading> command(const HaplyDevices& devices, const std::array<double, 3>& force_N);

  HaplyOptions options_;
  std::string uri_;                      ///< begins each line
  std::optional<HaplyDevices> devices_;  ///< those of the first open()
  std::unique_ptr<Socket> socket_;
};

}  // namespace trocar::runtime
