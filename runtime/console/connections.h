// SPDX-License-Identifier: Apache-2.0
// The connections of the console, by HTTP and by WebSocket. Boost.Beast takes long to compile, so
// only files that handle sockets include this header.
#pragma once

#include <array>
#include <boost/asio.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>
#include <chrono>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>  // must come before asio, which uses std::exchange without including it
#include <vector>

#include "runtime/console/access.h"
#include "runtime/console/api.h"
#include "runtime/console/server.h"
#include "runtime/console/supervisor.h"

namespace trocar::runtime {

namespace net = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
namespace websocket = beast::websocket;
using tcp = net::ip::tcp;
using Request = http::request<http::string_body>;

// Stores what one WebSocket client has received so far, and determines the client's next message.
// No messages are queued for a slow client: whenever the client can take a message, the message is
// made from the supervisor's present state.

/// A message: a text, or the contents of a binary message (Frame) with its kind and number
/// (protocol.md).
struct ClientMessage {
  std::string text;
  Frame frame;  ///< null: the message is text
  std::uint32_t kind = 0, number = 0;
};

class ClientProgress {
 public:
  using Clock = std::chrono::steady_clock;

  /// Call this before the first next() if the client connects again. `last_event`: number of the
  /// last event (such as a puncture or a fault) of this session that the client already has.
  void resume_after(std::uint64_t last_event) noexcept { first_cursor_ = last_event; }
  /// Returns the next message for the client, or nullopt if no message is due. If several messages
  /// are due, the order is: description of the session, holder of the live hand, events, state of
  /// the session, binary messages. `hand`: who holds the live hand; ignored if the session has no
  /// live hand. `has_new_snapshot`: the last Supervisor::poll() has read a new snapshot.
  std::optional<ClientMessage> next(const Supervisor& session, Role role, HandShare hand,
                                    bool has_new_snapshot, Clock::time_point now);
  /// Call this when the client has let go of the live hand. The client then gets a message with its
  /// HandShare (access.h: who holds the hand), even if the HandShare is the same as in the last
  /// such message because the client has already taken the hand again.
  void forget_hand() noexcept { hand_.reset(); }
  /// Call this when the client reports that it has drawn the binary messages up to `number`. While
  /// four binary messages are not reported as drawn, the client gets no further binary message.
  void acknowledge(std::uint64_t number);
  /// Returns true if a binary message has been waiting for its acknowledgement for more than 6 s.
  /// The caller then closes the connection.
  bool is_stalled(Clock::time_point now) const;

 private:
  struct Outstanding {
    std::uint32_t number = 0, kind = 0;
    Clock::time_point sent_at;
  };
  ClientMessage hello(const SessionTelemetry& session, Role role);
  std::optional<ClientMessage> next_events(const SessionTelemetry& session);
  std::optional<ClientMessage> next_snapshot(const SessionTelemetry& session, bool has_new_snapshot,
                                             Clock::time_point now);
  ClientMessage binary(std::uint32_t kind, Frame frame, Clock::time_point now);

  bool said_hello_ = false, has_history_ = false;
  std::uint64_t session_ = 0, state_ = 0, cursor_ = 0, first_cursor_ = 0, snapshot_ = 0;
  /// The holder of the live hand that was last reported to the client; nullopt: report it next.
  std::optional<HandShare> hand_;
  std::vector<std::uint64_t> sheet_versions_;
  std::uint64_t shape_version_ = 0;
  std::uint32_t number_ = 0;  ///< number of the last binary message
  std::deque<Outstanding> outstanding_;
  Clock::time_point snapshot_at_;
};

// One HTTP connection: reads requests one after the other, checks whether they may be answered, and
// sends the answers.

class HttpConnection : public std::enable_shared_from_this<HttpConnection> {
 public:
  HttpConnection(ConsoleState& console, tcp::socket socket, std::string from);
  /// Reads and answers one request after the other until the connection ends.
  void read();
  /// True while the connection waits for a request, or for its end. When a client connects and there
  /// are already 64 connections, the server closes an idle one, or if there is none, one without a
  /// valid token.
  bool is_idle() const noexcept { return is_idle_; }
  bool has_shown_token() const noexcept { return has_shown_token_; }
  void close();

 private:
  void on_error(beast::error_code error);
  /// Logs a refused request, answers with `status`, and closes the connection.
  void refuse(unsigned status, const char* kind);
  void refuse_host(const Request& request);
  void answer(const Request& request);
  void answer_file(const std::string& path, bool is_get);
  /// Runs `work` on the worker thread, and then sends the answer that `work` returned.
  void later(std::function<Answer()> work);
  void send(Answer answer);
  void drain();
  void open_client(const Request& request);

  ConsoleState& console_;
  beast::tcp_stream stream_;
  std::string from_;
  beast::flat_buffer buffer_;
  std::optional<http::request_parser<http::string_body>> parser_;
  unsigned version_ = 11;
  bool keep_ = false, is_idle_ = true, has_shown_token_ = false;
  int drained_ = 0;
};

struct HandRequest;

/// One client, which is a page or a script that is connected by the WebSocket /live (protocol.md).
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
