// SPDX-License-Identifier: Apache-2.0
// Sends data of the console's session to OpenIGTLink clients, such as 3D Slicer: the tool's pose,
// the force, the session's state, and the bone's surface (docs/openigtlink.md). Nothing is queued
// for a client: when the previous messages to the client have been sent, the next messages are
// chosen from the present state.
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>

#include "formats/base/result.h"

namespace trocar::runtime {

struct ConsoleState;

struct IgtlAddress {
  std::string address = "127.0.0.1";  ///< numerical IPv4 or IPv6 address
  std::uint16_t port = 0;             ///< 0: any free port
};
/// Reads an address of the form [ADDRESS:]PORT, in which an IPv6 address has brackets. Without
/// ADDRESS, the address is 127.0.0.1. Errors: kUsage if the text has another form.
Result<IgtlAddress> parse_igtl_address(std::string_view text);

class IgtlServer {
 public:
  using Clock = std::chrono::steady_clock;

  /// Makes a server that listens on `address`. `console` must outlive it. Errors: kUnwritable if it
  /// cannot listen on `address`.
  static Result<std::unique_ptr<IgtlServer>> listen(ConsoleState& console,
                                                    const IgtlAddress& address);
  virtual ~IgtlServer() = default;
  IgtlServer(const IgtlServer&) = delete;
  IgtlServer& operator=(const IgtlServer&) = delete;

  /// ADDRESS:PORT on which the server listens.
  virtual std::string endpoint() const = 0;
  /// Sends the changed parts of the session's state to each client whose previous messages have been
  /// sent, a pose at most 60 times in a second. If a client leaves sent data unread for 6 s, it is
  /// disconnected. If there is a client, the worker thread (ConsoleState::worker) also loads the bone
  /// of the session. Call this after each poll of the supervisor.
  virtual void poll(Clock::time_point now) = 0;

 protected:
  IgtlServer() = default;
};

}  // namespace trocar::runtime
