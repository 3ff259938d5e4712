// SPDX-License-Identifier: Apache-2.0
// The WebSocket /live of one client, which is a page or a script (protocol.md).
// Tests: tests/e2e/console_clients_test.py
#pragma once

#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "runtime/console/beast.h"
#include "runtime/console/client_progress.h"
#include "runtime/console/console_state.h"

namespace trocar::runtime {

/// A client's message for the live hand.
struct HandRequest {
  std::optional<std::array<double, 6>> target;  ///< none: the client lets go of the hand
  std::uint64_t number = 0;                     ///< increases with each message of the client
};

class TelemetryClient : public std::enable_shared_from_this<TelemetryClient> {
 public:
  using Clock = std::chrono::steady_clock;
  TelemetryClient(ConsoleState& console, beast::tcp_stream stream, std::string from)
      : console_(console), socket_(std::move(stream)), from_(std::move(from)) {}

  /// Answers the handshake. The client must send its token within 5 s.
  void run(const Request& request);
  /// Sends the next message if the previous one has been sent. Closes the connection if the
  /// client has stalled.
  void pump(Clock::time_point now);
  /// Closes the connection without a closing message.
  void abort();
  Role role() const noexcept { return role_; }  ///< kNone until the first message

 private:
  void read();
  void on_error(beast::error_code error);
  void on_message();
  bool on_first(const std::string& text);
  bool on_later(const std::string& text);
  bool on_hand(const HandRequest& request);
  void release_hand();
  /// True if the number of clients with this client's role is within the limit.
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
