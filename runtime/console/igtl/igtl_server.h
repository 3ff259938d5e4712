// SPDX-License-Identifier: Apache-2.0
// Sends one session's poses, forces, state and surface to OpenIGTLink clients. Nothing is queued: what
// a client gets next is chosen when its last message has been sent.
// Tests: tests/e2e/console_igtl_test.py
#pragma once

#include <boost/asio/io_context.hpp>
#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "formats/base/result.h"
#include "runtime/console/igtl/igtl_address.h"

namespace trocar::runtime {

/// Packed messages, shared by all clients.
using IgtlBytes = std::shared_ptr<const std::string>;

/// The present state of a session. A client gets a part when its number is not that of the last part it
/// got, and everything again when `session` changes.
struct IgtlState {
  std::uint64_t session = 0;
  std::uint64_t status_number = 0;
  IgtlBytes status;
  std::uint64_t tick_number = 0;
  IgtlBytes tick;     ///< pose, force and time of one tick; null: none yet
  IgtlBytes surface;  ///< null: there is none, or not yet; also sent on request
};

class IgtlServer {
 public:
  using Clock = std::chrono::steady_clock;
  /// Reports a kind of refusal, and the client's address.
  using Refused = std::function<void(const char* kind, const std::string& from)>;

  /// Errors: (unwritable) the server cannot listen on the address.
  static Result<std::unique_ptr<IgtlServer>> listen(boost::asio::io_context& context,
                                                    const IgtlAddress& address, Refused refused);
  virtual ~IgtlServer() = default;
  IgtlServer(const IgtlServer&) = delete;
  IgtlServer& operator=(const IgtlServer&) = delete;

  /// ADDRESS:PORT on which the server listens.
  virtual std::string endpoint() const = 0;
  virtual bool has_clients() const = 0;
  /// Sends what is new to the clients that can take it, poses at most 60 times a second. Disconnects
  /// clients that have stalled. Call it every few milliseconds.
  virtual void pump(const IgtlState& state, Clock::time_point now) = 0;

 protected:
  IgtlServer() = default;
};

}  // namespace trocar::runtime
