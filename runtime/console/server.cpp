// SPDX-License-Identifier: Apache-2.0
#include "runtime/console/server.h"

#include <boost/asio.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <sstream>

#include "formats/base/json.h"
#include "formats/base/text.h"
#include "runtime/console/api.h"

namespace trocar::runtime {

namespace net = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
namespace websocket = beast::websocket;
using tcp = net::ip::tcp;
using Request = http::request<http::string_body>;

/// A message: a text, or the contents of a binary message (Frame) with its kind and number
/// (protocol.md).
struct ClientMessage {
  std::string text;
  Frame frame;  ///< null: the message is text
  std::uint32_t kind = 0, number = 0;
};

/// A client's message for the live hand: it moves the hand or lets go of it.
struct HandRequest {
  /// The target of the hand (Supervisor::move_hand()); nullopt: the client lets go of the hand.
  std::optional<std::array<double, 6>> target;
  /// Number of a message that moves the hand. A client gives each later message a higher number.
  /// Always 0 if `target` is nullopt.
  std::uint64_t number = 0;
};

namespace {

using nlohmann::json;
using SteadyClock = std::chrono::steady_clock;

constexpr std::uint32_t kSnapshot = 1, kSheet = 2, kShape = 3, kHistory = 4;
constexpr std::size_t kMaxOutstanding = 4, kMaxSnapshotsOutstanding = 2, kMaxEventsOfMessage = 64;
constexpr auto kSnapshotEvery = std::chrono::milliseconds(15);
constexpr auto kSnapshotAnyway = std::chrono::milliseconds(50);  // for a session's last snapshot
constexpr auto kStalled = std::chrono::seconds(6);

ClientMessage text_message(std::string text) {
  return {std::move(text), nullptr};
}

// An audience never takes an operator's place.
constexpr std::size_t kMaxAudience = 16, kMaxOperators = 8;
constexpr std::uint64_t kMaxMessage = 4 << 10;
constexpr auto kSilence = std::chrono::seconds(6);
constexpr auto kFirstMessageWithin = std::chrono::seconds(5);
constexpr int kSendBuffer = 65536;
// Largest coordinate and largest component of the rotation vector of a hand's target.
constexpr double kMaxHand_m = 1, kMaxHand_rad = 7;

/// Returns the request of a message that has the key `hand`; none: it is malformed.
std::optional<HandRequest> hand_request(const json& message) {
  HandRequest request;
  const json& hand = message.at("hand");
  const auto n = message.find("n");
  const bool has_number = n != message.end() && n->is_number_unsigned();
  if (message.size() != (has_number ? 2U : 1U)) return std::nullopt;
  if (hand.is_null()) return request;
  std::array<double, 6>& target = request.target.emplace();
  if (!has_number || !hand.is_array() || hand.size() != target.size()) return std::nullopt;
  request.number = n->get<std::uint64_t>();
  for (std::size_t i = 0; i < target.size(); ++i) {
    if (!hand[i].is_number()) return std::nullopt;
    target[i] = hand[i].get<double>();
    if (!(std::abs(target[i]) <= (i < 3 ? kMaxHand_m : kMaxHand_rad))) return std::nullopt;
  }
  return request;
}

/// Sockets that have not said yet who they are; one more ends the oldest of them.
constexpr std::size_t kMaxUnknown = 8;
constexpr std::uint32_t kMaxHeader = 8 << 10;
constexpr std::uint64_t kMaxBody = 4 << 10;
constexpr auto kRequestWithin = std::chrono::seconds(20);
constexpr std::size_t kSlowBytes_per_s = 500'000;  ///< a client may be as slow as this
constexpr auto kDrainWithin = std::chrono::seconds(1);
constexpr int kMaxDrained = 64;

constexpr const char* kForeignHost =
    R"(This console does not answer under the address in your browser.

Through a tunnel or a proxy, start it with that address:

    trocar-console FOLDER --public-url http://HOST:PORT

Or let the tunnel begin at the port that the console printed:

    ssh -L PORT:127.0.0.1:PORT HOST
)";

std::string_view view_of(beast::string_view text) {
  return {text.data(), text.size()};
}

constexpr std::size_t kMaxConnections = 64;
// The period of polling is short, because a client gets a snapshot as soon as it has been read.
constexpr auto kPollEvery = std::chrono::milliseconds(2), kPollIdle = std::chrono::milliseconds(25);
constexpr auto kRetryAccept = std::chrono::milliseconds(100);
constexpr auto kEndWithin = std::chrono::seconds(10);

// An IPv6 address stands in brackets.
std::string text_of(const tcp::endpoint& endpoint) {
  return (std::ostringstream() << endpoint).str();
}

}  // namespace

/// Stores what one WebSocket client has received so far, and determines the client's next message.
/// No messages are queued for a slow client: whenever the client can take a message, the message is
/// made from the supervisor's present state.
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
                                    bool has_new_snapshot, Clock::time_point now) {
    const SessionTelemetry& telemetry = session.telemetry();
    if (!said_hello_ || session_ != telemetry.sessions()) return hello(telemetry, role);
    if (telemetry.about().has_live_hand && hand_ != hand) {
      hand_ = hand;
      return text_message(std::string(R"({"hand":")") + to_string(hand) + "\"}");
    }
    // Events come before the state, so that a client that reads "ended" has received all of them.
    if (cursor_ < telemetry.last_event()) {
      if (auto message = next_events(telemetry)) return message;
    }
    if (state_ != session.state_version()) {
      state_ = session.state_version();
      return text_message(session.state_json());
    }
    if (outstanding_.size() >= kMaxOutstanding) return std::nullopt;
    if (!std::exchange(has_history_, true) && !telemetry.history().points().empty())
      return binary(
          kHistory,
          std::make_shared<const std::string>(history_message(telemetry.history().points())), now);
    if (auto message = next_snapshot(telemetry, has_new_snapshot, now)) return message;
    const auto& sheets = telemetry.sheets();
    for (std::size_t i = 0; i < sheets.size(); ++i) {
      if (sheet_versions_[i] == sheets[i].version) continue;
      sheet_versions_[i] = sheets[i].version;
      if (sheets[i].frame) return binary(kSheet, sheets[i].frame, now);
    }
    if (shape_version_ != telemetry.shape().version && telemetry.shape().frame) {
      shape_version_ = telemetry.shape().version;
      return binary(kShape, telemetry.shape().frame, now);
    }
    return std::nullopt;
  }
  /// Call this when the client has let go of the live hand. The client then gets a message with its
  /// HandShare (access.h: who holds the hand), even if the HandShare is the same as in the last
  /// such message because the client has already taken the hand again.
  void forget_hand() noexcept { hand_.reset(); }
  /// Call this when the client reports that it has drawn the binary messages up to `number`. While
  /// four binary messages are not reported as drawn, the client gets no further binary message.
  void acknowledge(std::uint64_t number) {
    while (!outstanding_.empty() && outstanding_.front().number <= number)
      outstanding_.pop_front();
  }
  /// Returns true if a binary message has been waiting for its acknowledgement for more than 6 s.
  /// The caller then closes the connection.
  bool is_stalled(Clock::time_point now) const {
    return !outstanding_.empty() && now - outstanding_.front().sent_at > kStalled;
  }

 private:
  struct Outstanding {
    std::uint32_t number = 0, kind = 0;
    Clock::time_point sent_at;
  };
  ClientMessage hello(const SessionTelemetry& session, Role role) {
    cursor_ = said_hello_ ? 0 : first_cursor_;
    said_hello_ = true;
    session_ = session.sessions();
    state_ = 0;
    hand_.reset();
    snapshot_ = 0;
    has_history_ = false;
    shape_version_ = 0;
    sheet_versions_.assign(session.sheets().size(), 0);
    const SessionAbout& about = session.about();
    if (about.json.empty())
      return text_message(R"({"hello":null,"session":"","columns":[],"last_event":0,"role":")" +
                          std::string(to_string(role)) + "\"}");
    return text_message("{\"hello\":" + about.json + ",\"session\":" + json_text(about.id) +
                        ",\"role\":\"" + to_string(role) + "\",\"columns\":" + about.columns +
                        ",\"last_event\":" + std::to_string(session.last_event()) + "}");
  }
  std::optional<ClientMessage> next_events(const SessionTelemetry& session) {
    const auto& events = session.events();
    auto event = std::upper_bound(events.begin(), events.end(), cursor_,
                                  [](std::uint64_t number, const SessionTelemetry::Event& one) {
                                    return number < one.number;
                                  });
    if (event == events.end()) return std::nullopt;
    if (event->number != cursor_ + 1) {
      const std::uint64_t missed = event->number - cursor_ - 1;
      cursor_ = event->number - 1;
      return text_message("{\"missed\":" + std::to_string(missed) + "}");
    }
    std::string text = "{\"events\":[";
    for (std::size_t i = 0;
         i < kMaxEventsOfMessage && event != events.end() && event->number == cursor_ + 1;
         ++i, ++event) {
      text += (i == 0 ? "" : ",") + event->json;
      cursor_ = event->number;
    }
    return text_message(text + "]}");
  }
  std::optional<ClientMessage> next_snapshot(const SessionTelemetry& session, bool has_new_snapshot,
                                             Clock::time_point now) {
    const auto out = std::count_if(outstanding_.begin(), outstanding_.end(),
                                   [](const Outstanding& one) { return one.kind == kSnapshot; });
    const bool is_due =
        snapshot_ != session.snapshots() &&
        (has_new_snapshot || snapshot_ == 0 || now - snapshot_at_ >= kSnapshotAnyway) &&
        static_cast<std::size_t>(out) < kMaxSnapshotsOutstanding &&
        now - snapshot_at_ >= kSnapshotEvery;
    if (!is_due || !session.snapshot()) return std::nullopt;
    snapshot_ = session.snapshots();
    snapshot_at_ = now;
    return binary(kSnapshot, session.snapshot(), now);
  }
  ClientMessage binary(std::uint32_t kind, Frame frame, Clock::time_point now) {
    outstanding_.push_back({++number_, kind, now});
    return {{}, std::move(frame), kind, number_};
  }

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

/// One client, which is a page or a script that is connected by the WebSocket /live (protocol.md).
class TelemetryClient : public std::enable_shared_from_this<TelemetryClient> {
 public:
  using Clock = std::chrono::steady_clock;
  TelemetryClient(ConsoleState& console, beast::tcp_stream stream, std::string from)
      : console_(console), socket_(std::move(stream)), from_(std::move(from)) {}

  /// Answers the handshake and begins to read messages. If the client does not send its token
  /// (Tokens in access.h) within 5 s, the connection is closed.
  void run(const Request& request) {
    beast::error_code ignored;
    socket_.next_layer().socket().set_option(net::socket_base::send_buffer_size(kSendBuffer),
                                             ignored);
    socket_.next_layer().expires_never();
    websocket::stream_base::timeout timeout{};
    timeout.handshake_timeout = kFirstMessageWithin;
    timeout.idle_timeout = kSilence;
    timeout.keep_alive_pings = true;
    socket_.set_option(timeout);
    websocket::permessage_deflate deflate;
    deflate.server_enable = false;
    socket_.set_option(deflate);
    socket_.read_message_max(kMaxMessage);
    socket_.auto_fragment(false);
    opened_at_ = Clock::now();
    socket_.async_accept(request, [self = shared_from_this()](beast::error_code error) {
      if (!error) self->read();
    });
  }
  /// Sends the next message, if the previous message has been sent and a message is due. If the
  /// client has stalled (ClientProgress::is_stalled()), closes the connection. The server calls
  /// this after each poll of the session.
  void pump(Clock::time_point now) {
    if (role_ == Role::kNone) {
      if (now - opened_at_ > kFirstMessageWithin) abort();
      return;
    }
    if (progress_.is_stalled(now)) return abort();
    if (is_writing_ || is_closing_) return;
    auto message = progress_.next(console_.supervisor, role_, console_.hand.share_of(this),
                                  console_.has_new_snapshot, now);
    if (!message) return;
    message_ = std::move(*message);
    is_writing_ = true;
    socket_.binary(message_.frame != nullptr);
    if (!message_.frame) return socket_.async_write(net::buffer(message_.text), written());
    head_ = {message_.kind, message_.number};
    socket_.async_write(
        std::array<net::const_buffer, 2>{net::buffer(head_), net::buffer(*message_.frame)},
        written());
  }
  /// Closes the connection immediately, without a closing message to the client.
  void abort() {
    beast::error_code ignored;
    is_closing_ = true;
    release_hand();
    beast::get_lowest_layer(socket_).socket().close(ignored);
  }
  Role role() const noexcept { return role_; }  ///< kNone until the client has sent its token

  /// Returns the number of connected clients with a role.
  static std::size_t count(const ConsoleState& console, Role role) {
    return static_cast<std::size_t>(
        std::count_if(console.clients.begin(), console.clients.end(), [role](const auto& one) {
          const auto client = one.lock();
          return client && client->role() == role;
        }));
  }

 private:
  void read() {
    socket_.async_read(buffer_, [self = shared_from_this()](beast::error_code error, std::size_t) {
      if (error) return self->on_error(error);
      self->on_message();
    });
  }
  void on_error(beast::error_code error) {
    is_closing_ = true;
    release_hand();
    if (error == websocket::error::message_too_big || error == websocket::error::buffer_overflow)
      console_.log.refused("a WebSocket message that is too long", from_);
    else if (error.category() == beast::error_code(websocket::error::bad_opcode).category() &&
             error != websocket::error::closed)
      console_.log.refused("a malformed WebSocket frame", from_);
  }
  void on_message() {
    const bool is_text = socket_.got_text();
    const std::string text = beast::buffers_to_string(buffer_.data());
    buffer_.consume(buffer_.size());
    if (is_closing_) return;
    const bool is_first = role_ == Role::kNone;
    const bool is_good = is_text && (is_first ? on_first(text) : on_later(text));
    if (!is_good) {
      console_.log.refused(is_first ? "a WebSocket without a valid token in its first message"
                                    : "a malformed WebSocket message",
                           from_);
      return close(websocket::close_code::policy_error);
    }
    if (is_first && !has_place()) {
      role_ = Role::kNone;
      console_.log.refused("a WebSocket beyond 16 of an audience or 8 of operators", from_);
      return close(websocket::close_code::try_again_later);
    }
    read();
    pump(Clock::now());
  }
  bool on_first(const std::string& text) {
    const Result<json> message = parse_strict_json(text, "message");
    if (!message || !message->is_object()) return false;
    JsonErrors errors{"message", {}};
    StrictObject object(*message, "", errors);
    const std::string token = object.string("token");
    std::string session;
    if (object.has("session")) session = object.string("session");
    constexpr std::int64_t kMax = std::int64_t{1} << 53;
    const std::int64_t last = object.integer("last_event", 0, kMax, 0);
    object.finish();
    if (errors.first) return false;
    role_ = console_.tokens.role_of(token);
    if (session == console_.supervisor.telemetry().about().id)
      progress_.resume_after(static_cast<std::uint64_t>(last));
    return role_ != Role::kNone;
  }
  bool on_later(const std::string& text) {
    const Result<json> message = parse_strict_json(text, "message");
    if (!message || !message->is_object()) return false;
    if (message->contains("hand")) {
      const std::optional<HandRequest> request = hand_request(*message);
      return request && on_hand(*request);
    }
    const auto ack = message->find("ack");
    if (message->size() != 1 || ack == message->end() || !ack->is_number_unsigned()) return false;
    progress_.acknowledge(ack->get<std::uint64_t>());
    return true;
  }
  bool on_hand(const HandRequest& request) {
    if (role_ != Role::kOperator) {
      console_.log.refused("a hand from an audience", from_);
      return false;
    }
    if (!request.target) {
      release_hand();
    } else if (console_.supervisor.has_hand() &&
               console_.hand.move(this, request.number, Clock::now())) {
      console_.supervisor.move_hand(request.target);
    }
    return true;
  }
  void release_hand() {
    if (!console_.hand.let_go(this)) return;
    progress_.forget_hand();
    if (console_.supervisor.has_hand()) console_.supervisor.move_hand(std::nullopt);
  }
  /// True if the number of clients with this client's role, including this client, is at most 16
  /// for kView, or 8 for kOperator.
  bool has_place() const {
    return count(console_, role_) <=  // with this one
           (role_ == Role::kOperator ? kMaxOperators : kMaxAudience);
  }
  void close(websocket::close_code code) {
    is_closing_ = true;
    release_hand();
    if (is_writing_) return abort();
    socket_.async_close(code, [self = shared_from_this()](beast::error_code) {});
  }
  std::function<void(beast::error_code, std::size_t)> written() {
    return [self = shared_from_this()](beast::error_code error, std::size_t) {
      self->is_writing_ = false;
      if (!error) self->pump(Clock::now());
    };
  }

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

/// One HTTP connection: reads requests one after the other, checks whether they may be answered, and
/// sends the answers.
class HttpConnection : public std::enable_shared_from_this<HttpConnection> {
 public:
  HttpConnection(ConsoleState& console, tcp::socket socket, std::string from)
      : console_(console),
        stream_(std::move(socket)),
        from_(std::move(from)),
        buffer_(kMaxHeader + kMaxBody) {}
  /// Reads and answers one request after the other until the connection ends.
  void read() {
    is_idle_ = true;
    parser_.emplace();
    parser_->header_limit(kMaxHeader);
    parser_->body_limit(kMaxBody);
    stream_.expires_after(kRequestWithin);
    http::async_read(stream_, buffer_, *parser_,
                     [self = shared_from_this()](beast::error_code error, std::size_t) {
                       self->is_idle_ = false;
                       if (error) return self->on_error(error);
                       self->answer(self->parser_->release());
                     });
  }
  /// True while the connection waits for a request, or for its end. When a client connects and there
  /// are already 64 connections, the server closes an idle one, or if there is none, one without a
  /// valid token.
  bool is_idle() const noexcept { return is_idle_; }
  bool has_shown_token() const noexcept { return has_shown_token_; }
  void close() {
    beast::error_code ignored;
    stream_.socket().close(ignored);
  }

 private:
  void on_error(beast::error_code error) {
    if (error == http::error::body_limit)
      return refuse(kBodyTooLong, "a request whose body is too long");
    if (error == http::error::header_limit || error == http::error::buffer_overflow)
      return refuse(kHeaderTooLong, "a request whose header is too long");
    if (error.category() == beast::error_code(http::error::bad_method).category() &&
        error != http::error::end_of_stream && error != http::error::partial_message)
      return refuse(kBadRequest, "a malformed request");
    close();
  }
  /// Logs a refused request, answers with `status`, and closes the connection.
  void refuse(unsigned status, const char* kind) {
    console_.log.refused(kind, from_);
    keep_ = false;
    send(failure(status, std::string("refused: ") + kind));
  }
  /// A person who comes through a tunnel or a proxy sees this answer in the browser.
  void refuse_host(const Request& request) {
    constexpr const char* kKind = "a request for a foreign Host";
    if (view_of(request.target()).starts_with("/api/")) return refuse(kMisdirected, kKind);
    console_.log.refused(kKind, from_);
    keep_ = false;
    send({kMisdirected, "text/plain; charset=utf-8", kForeignHost});
  }
  void answer(const Request& request) {
    version_ = request.version();
    keep_ = request.keep_alive();
    const std::string_view host = view_of(request[http::field::host]);
    if (request.count(http::field::host) != 1 || !console_.hosts.is_host(host))
      return refuse_host(request);
    if (request.count(http::field::origin) > 0 &&
        (request.count(http::field::origin) != 1 ||
         !console_.hosts.is_origin(view_of(request[http::field::origin]), host)))
      return refuse(kForbidden, "a request with a foreign Origin");
    auto target = RequestTarget::parse(view_of(request.target()));
    if (!target) return refuse(kBadRequest, "a malformed request");
    const bool is_get = request.method() == http::verb::get,
               is_post = request.method() == http::verb::post;
    if (target->path == "/live") return open_client(request);
    if (!target->path.starts_with("/api/")) return answer_file(target->path, is_get);
    if (target->path == "/api/emergency_stop") {
      if (!is_post) return send(method_not_allowed());
      console_.log.emergency_stop(from_);
      return send(answer_emergency_stop(console_));
    }
    const Role role =
        request.count(http::field::authorization) == 1
            ? console_.tokens.role_of_header(view_of(request[http::field::authorization]))
            : Role::kNone;
    if (role == Role::kNone) return refuse(kUnauthorized, "a request without a valid token");
    has_shown_token_ = true;
    Reply reply =
        answer_api(console_, {std::move(*target), is_get, is_post, role, request.body(), from_});
    if (auto* const now = std::get_if<Answer>(&reply)) return send(std::move(*now));
    later(std::get<std::function<Answer()>>(std::move(reply)));
  }
  void answer_file(const std::string& path, bool is_get) {
    const PageFile* const file = console_.page.find(path);
    if (file == nullptr) return send(failure(kNotFound, "there is no such page"));
    if (!is_get) return send(method_not_allowed());
    send({200, file->type, file->bytes, console_.page.security_policy()});
  }
  /// Runs `work` on the worker thread, and then sends the answer that `work` returned.
  void later(std::function<Answer()> work) {
    stream_.expires_never();
    net::post(console_.worker, [self = shared_from_this(), work = std::move(work)] {
      auto answer = std::make_shared<Answer>();
      try {
        *answer = work();
      } catch (const std::exception& thrown) {  // a hostile file must not end the console
        *answer = failure(kInternalError, std::string("internal error: ") + thrown.what());
      }
      net::post(self->console_.context, [self, answer] { self->send(std::move(*answer)); });
    });
  }
  void send(Answer answer) {
    if (!answer.shared) answer.shared = std::make_shared<const std::string>(std::move(answer.body));
    const std::size_t bytes = answer.shared->size();
    auto response = std::make_shared<http::response<http::span_body<const char>>>();
    response->body() = {answer.shared->data(), bytes};
    response->result(answer.status);
    response->version(version_);
    response->set(http::field::content_type, answer.type);
    response->set(http::field::cache_control, "no-store");
    response->set("X-Content-Type-Options", "nosniff");
    response->set("Referrer-Policy", "no-referrer");
    response->set("Cross-Origin-Resource-Policy", "same-origin");
    response->set("Content-Security-Policy", answer.policy);
    response->keep_alive(keep_);
    response->prepare_payload();
    // A large answer may take longer, through a tunnel or to a tablet.
    stream_.expires_after(kRequestWithin + std::chrono::seconds(bytes / kSlowBytes_per_s));
    http::async_write(stream_, *response,
                      [self = shared_from_this(), response, kept = answer.shared](
                          beast::error_code error, std::size_t) {
                        if (error) return;
                        if (self->keep_) return self->read();
                        beast::error_code ignored;
                        self->stream_.socket().shutdown(tcp::socket::shutdown_send, ignored);
                        self->drain();
                      });
  }
  /// Reads remaining data from the peer for a short time. If the socket were closed with unread data,
  /// the connection would be reset, and the peer would lose the answer.
  void drain() {
    is_idle_ = true;
    buffer_.consume(buffer_.size());
    stream_.expires_after(kDrainWithin);
    stream_.async_read_some(buffer_.prepare(kMaxBody),
                            [self = shared_from_this()](beast::error_code error, std::size_t) {
                              if (!error && ++self->drained_ < kMaxDrained) self->drain();
                            });
  }
  void open_client(const Request& request) {
    if (!websocket::is_upgrade(request))
      return send(failure(kUpgradeRequired, "/live is a WebSocket"));
    count_living(console_.clients);  // removes those that have ended
    if (TelemetryClient::count(console_, Role::kNone) >= kMaxUnknown) {
      for (const auto& one : console_.clients) {
        const auto client = one.lock();
        if (!client || client->role() != Role::kNone) continue;
        client->abort();
        break;
      }
    }
    auto client = std::make_shared<TelemetryClient>(console_, std::move(stream_), from_);
    console_.clients.push_back(client);
    client->run(request);
  }

  ConsoleState& console_;
  beast::tcp_stream stream_;
  std::string from_;
  beast::flat_buffer buffer_;
  std::optional<http::request_parser<http::string_body>> parser_;
  unsigned version_ = 11;
  bool keep_ = false, is_idle_ = true, has_shown_token_ = false;
  int drained_ = 0;
};

namespace {

/// Accepts connections, polls the session, and ends on a signal.
class Server {
 public:
  /// `igtl`: null if OpenIGTLink clients are not served.
  Server(ConsoleState& console, tcp::acceptor acceptor, std::unique_ptr<IgtlServer> igtl)
      : console_(console),
        igtl_(std::move(igtl)),
        acceptor_(std::move(acceptor)),
        timer_(console.context),
        signals_(console.context, SIGINT, SIGTERM, SIGHUP) {
    console_.poll_soon = [this] {
      timer_.expires_after(SteadyClock::duration::zero());
      wait();
    };
  }

  void run() {
    accept();
    poll();
    await_signal();
    console_.context.run();
    console_.worker.join();
  }

 private:
  void accept() {
    acceptor_.async_accept([this](beast::error_code error, tcp::socket socket) {
      if (error == net::error::operation_aborted) return;
      if (!error) {
        open(std::move(socket));
        return accept();
      }
      // The process has no free descriptors. They become free when connections end.
      retry_.expires_after(kRetryAccept);
      retry_.async_wait([this](beast::error_code) { accept(); });
    });
  }

  /// Closes the oldest idle connection or, if none is idle, the oldest one without a valid token.
  static void close_one(const std::vector<std::weak_ptr<HttpConnection>>& all) {
    std::shared_ptr<HttpConnection> unknown;
    for (const auto& one : all) {
      const auto connection = one.lock();
      if (!connection) continue;
      if (connection->is_idle()) return connection->close();
      if (!unknown && !connection->has_shown_token()) unknown = connection;
    }
    if (unknown) unknown->close();
  }

  void open(tcp::socket socket) {
    beast::error_code error;
    const tcp::endpoint peer = socket.remote_endpoint(error);
    if (error) return;
    socket.set_option(tcp::no_delay(true), error);
    auto& all = console_.connections;
    if (count_living(all) >= kMaxConnections) {
      console_.log.refused("a connection beyond 64", text_of(peer));
      close_one(all);
      if (all.size() >= 2 * kMaxConnections) return;
    }
    auto connection = std::make_shared<HttpConnection>(console_, std::move(socket), text_of(peer));
    all.push_back(connection);
    connection->read();
  }

  void poll() {
    const auto now = SteadyClock::now();
    const std::uint64_t snapshots = console_.supervisor.telemetry().snapshots();
    console_.supervisor.poll(now);
    if (console_.hand.lose_silent(now) && console_.supervisor.has_hand())
      console_.supervisor.move_hand(std::nullopt);
    console_.has_new_snapshot = console_.supervisor.telemetry().snapshots() != snapshots;
    for (std::size_t i = 0; i < console_.clients.size(); ++i) {
      if (const auto client = console_.clients[i].lock()) client->pump(now);
    }
    count_living(console_.clients);
    if (igtl_) igtl_->poll(now);
    if (is_stopping_ && console_.supervisor.end_all(now, kEndWithin)) {
      console_.context.stop();
      return;
    }
    timer_.expires_after(console_.supervisor.is_live() || is_stopping_ ? kPollEvery : kPollIdle);
    wait();
  }

  void wait() {
    timer_.async_wait([this](beast::error_code error) {
      if (!error) poll();
    });
  }

  void await_signal() {
    signals_.async_wait([this](beast::error_code error, int) {
      if (error) return;
      if (is_stopping_) return console_.context.stop();  // a second signal ends immediately
      is_stopping_ = true;
      beast::error_code ignored;
      acceptor_.close(ignored);
      console_.poll_soon();
      await_signal();
    });
  }

  ConsoleState& console_;
  std::unique_ptr<IgtlServer> igtl_;
  tcp::acceptor acceptor_;
  net::steady_timer timer_, retry_{console_.context};
  net::signal_set signals_;
  bool is_stopping_ = false;
};

}  // namespace

Result<void> serve(const ServerSettings& settings, Files files, PageFiles page) {
  beast::error_code error;
  const net::ip::address address = net::ip::make_address(settings.listen, error);
  if (error) return usage("--listen " + settings.listen + ": is no numerical address");
  net::io_context context(1);
  tcp::acceptor acceptor(context);
  const tcp::endpoint endpoint(address, settings.port);
  acceptor.open(endpoint.protocol(), error);
  if (!error) acceptor.set_option(net::socket_base::reuse_address(true), error);
  if (!error) acceptor.bind(endpoint, error);
  if (!error) acceptor.listen(net::socket_base::max_listen_connections, error);
  if (error)
    return unwritable("cannot listen on " + text_of(endpoint) + ": " + error.message() +
                      "; --port 0 takes any free port");
  const std::uint16_t port = acceptor.local_endpoint().port();
  const std::string host = address.is_unspecified() ? "127.0.0.1"
                           : address.is_v6()        ? "[" + address.to_string() + "]"
                                                    : address.to_string();
  ConsoleState console(context, settings, std::move(files), std::move(page),
                       HostNames(address.to_string(), port, settings.public_url));
  std::unique_ptr<IgtlServer> igtl;
  if (settings.igtl) {
    if (const auto ok = IgtlServer::listen(console, *settings.igtl).into(igtl); !ok)
      return ok.error();
  }
  const std::string link =
      (settings.public_url.empty() ? "http://" + host + ":" + std::to_string(port)
                                   : settings.public_url) +
      "/#";
  const std::string igtl_endpoint = igtl ? igtl->endpoint() : "";
  // The server must exist before the links are printed, because it catches the signals of whoever reads them.
  Server server(console, std::move(acceptor), std::move(igtl));
  print(stdout, "operator: %s%s\naudience: %s%s\n", link, console.tokens.of_operator(), link,
        console.tokens.of_view());
  if (!igtl_endpoint.empty()) print(stdout, "OpenIGTLink: %s\n", igtl_endpoint);
  std::fflush(stdout);
  server.run();
  return {};
}

void RefusalLog::refused(const char* kind, const std::string& from) {
  if (reported_.insert(kind).second)
    print(stderr, "trocar-console: refused: %s, from %s (further ones are not reported)\n", kind,
          from);
}

void RefusalLog::emergency_stop(const std::string& from) {
  constexpr auto kQuiet = std::chrono::seconds(10);
  const auto now = std::chrono::steady_clock::now();
  if (last_stop_ && now - *last_stop_ < kQuiet) return;
  last_stop_ = now;
  print(stderr, "trocar-console: emergency stop, asked for from %s\n", from);
}

}  // namespace trocar::runtime
