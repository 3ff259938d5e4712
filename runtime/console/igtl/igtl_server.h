// SPDX-License-Identifier: Apache-2.0
// Sends data of one session to OpenIGTLink clients: the tool's pose, the force, the session's state
// and the bone's surface. Nothing is queued for a client: when the previous messages to the client
// have been sent, the next messages are chosen from the present state.
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

/// The present state of a session as messages: status, latest tick, and surface. A client gets the
/// status when `status_number` has changed, the tick when `tick_number` has changed, and the
/// surface once. When `session` changes, the client gets all three again. On request, a client also
/// gets the status or the surface again.
struct IgtlState {
  std::uint64_t session = 0;
  std::uint64_t status_number = 0;
  IgtlBytes status;
  std::uint64_t tick_number = 0;
  IgtlBytes tick;     ///< pose, force and time of one tick; null: no tick yet
  IgtlBytes surface;  ///< null: there is no surface, or it is not loaded yet
};

class IgtlServer {
 public:
  using Clock = std::chrono::steady_clock;
  /// A function that is called when a client is refused. `kind`: the reason. `from`:
  /// the client's address.
  using Refused = std::function<void(const char* kind, const std::string& from)>;

  /// Makes a server that listens on `address`. Errors: kUnwritable if it cannot
  /// listen on `address`.
  static Result<std::unique_ptr<IgtlServer>> listen(boost::asio::io_context& context,
                                                    const IgtlAddress& address, Refused refused);
  virtual ~IgtlServer() = default;
  IgtlServer(const IgtlServer&) = delete;
  IgtlServer& operator=(const IgtlServer&) = delete;

  /// ADDRESS:PORT on which the server listens.
  virtual std::string endpoint() const = 0;
  virtual bool has_clients() const = 0;
  /// Sends the changed parts of the state to each client whose previous messages have been sent. A
  /// client gets IgtlState::tick at most 60 times in a second. If a client leaves sent data unread
  /// for 6 s, it is disconnected. Call this every few milliseconds.
  virtual void pump(const IgtlState& state, Clock::time_point now) = 0;

 protected:
  IgtlServer() = default;
};

}  // namespace trocar::runtime
