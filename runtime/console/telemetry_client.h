// SPDX-License-Identifier: Apache-2.0
// One client, which is a page or a script that is connected by the WebSocket /live (protocol.md).
#pragma once

#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "runtime/console/connections.h"
#include "runtime/console/server.h"

namespace trocar::runtime {

/// A client's message for the live hand: it moves the hand or lets go of it.
struct HandRequest {
  /// The target of the hand (Supervisor::move_hand()); nullopt: the client lets go of the hand.
  std::optional<std::array<double, 6>> target;
  /// Number of a message that moves the hand. A client gives each later message a higher number.
  /// Always 0 if `target` is nullopt.
  std::uint64_t number = 0;
};

class TelemetryClient : public std::enable_shared_from_this<TelemetryClient> {
 public:
  using Clock = std::chrono::steady_clock;
  TelemetryClient(ConsoleState& console, beast::tcp_stream stream, std::string from)
      : console_(console), socket_(std::move(stream)), from_(std::move(from)) {}

  /// Answers the handshake and begins to read messages. If the client does not send its token
  /// (Tokens in access.h) within 5 s, the connection is closed.
  void run(const Request& request);
  /// Sends the next message, if the previous message has been sent and a message is due. If the
  /// client has stalled (ClientProgress::is_stalled()), closes the connection. The server calls
  /// this after each poll of the session.
  void pump(Clock::time_point now);
  /// Closes the connection immediately, without a closing message to the client.
  void abort();
  Role role() const noexcept { return role_; }  ///< kNone until the client has sent its token

 private:
  void read();
  void on_error(beast::error_code error);
  void on_message();
  bool on_first(const std::string& text);
  bool on_later(const std::string& text);
  bool on_hand(const HandRequest& request);
  void release_hand();
  /// True if the number of clients with this client's role, including this client, is at most 16
  /// for kView, or 8 for kOperator.
  bool has_place() const;
  void close(websocket::close_code code);
  std::function<void(beast::error_code, std::size_t)> written();

  ConsoleState& console_;
  websocket::stream<beast::tcp_stream> socket_;
  std::string from_;
  beast::flat_buffer buffer_;
  Role role_ = Role::kNone;
  bool is_writing_ = false, is_closing_ = false;
  Clock::time_point opened_at_;
  ClientProgress progress_;
  ClientMessage message_;  ///< the message that is being sent
  std::array<std::uint32_t, 2> head_{};
};

/// Returns the number of connected clients with a role.
std::size_t count_clients(const ConsoleState& console, Role role);

}  // namespace trocar::runtime
