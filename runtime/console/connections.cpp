// SPDX-License-Identifier: Apache-2.0
#include "runtime/console/connections.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "formats/base/json.h"

namespace trocar::runtime {
namespace {

constexpr std::uint32_t kSnapshot = 1, kSheet = 2, kShape = 3, kHistory = 4;
constexpr std::size_t kMaxOutstanding = 4, kMaxSnapshotsOutstanding = 2, kMaxEventsOfMessage = 64;
constexpr auto kSnapshotEvery = std::chrono::milliseconds(15);
constexpr auto kSnapshotAnyway = std::chrono::milliseconds(50);  // for a session's last snapshot
constexpr auto kStalled = std::chrono::seconds(6);

ClientMessage text_message(std::string text) {
  return {std::move(text), nullptr};
}

}  // namespace

std::optional<ClientMessage> ClientProgress::next(const Supervisor& session, Role role,
                                                  HandShare hand, bool has_new_snapshot,
                                                  Clock::time_point now) {
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

ClientMessage ClientProgress::hello(const SessionTelemetry& session, Role role) {
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

std::optional<ClientMessage> ClientProgress::next_events(const SessionTelemetry& session) {
  const auto& events = session.events();
  auto event = std::upper_bound(
      events.begin(), events.end(), cursor_,
      [](std::uint64_t number, const SessionTelemetry::Event& one) { return number < one.number; });
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

std::optional<ClientMessage> ClientProgress::next_snapshot(const SessionTelemetry& session,
                                                           bool has_new_snapshot,
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

ClientMessage ClientProgress::binary(std::uint32_t kind, Frame frame, Clock::time_point now) {
  outstanding_.push_back({++number_, kind, now});
  return {{}, std::move(frame), kind, number_};
}

void ClientProgress::acknowledge(std::uint64_t number) {
  while (!outstanding_.empty() && outstanding_.front().number <= number)
    outstanding_.pop_front();
}

bool ClientProgress::is_stalled(Clock::time_point now) const {
  return !outstanding_.empty() && now - outstanding_.front().sent_at > kStalled;
}

namespace {

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

}  // namespace

HttpConnection::HttpConnection(ConsoleState& console, tcp::socket socket, std::string from)
    : console_(console),
      stream_(std::move(socket)),
      from_(std::move(from)),
      buffer_(kMaxHeader + kMaxBody) {}

void HttpConnection::read() {
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

void HttpConnection::close() {
  beast::error_code ignored;
  stream_.socket().close(ignored);
}

void HttpConnection::on_error(beast::error_code error) {
  if (error == http::error::body_limit)
    return refuse(kBodyTooLong, "a request whose body is too long");
  if (error == http::error::header_limit || error == http::error::buffer_overflow)
    return refuse(kHeaderTooLong, "a request whose header is too long");
  if (error.category() == beast::error_code(http::error::bad_method).category() &&
      error != http::error::end_of_stream && error != http::error::partial_message)
    return refuse(kBadRequest, "a malformed request");
  close();
}

void HttpConnection::refuse(unsigned status, const char* kind) {
  console_.log.refused(kind, from_);
  keep_ = false;
  send(failure(status, std::string("refused: ") + kind));
}

/// A person who comes through a tunnel or a proxy sees this answer in the browser.
void HttpConnection::refuse_host(const Request& request) {
  constexpr const char* kKind = "a request for a foreign Host";
  if (view_of(request.target()).starts_with("/api/")) return refuse(kMisdirected, kKind);
  console_.log.refused(kKind, from_);
  keep_ = false;
  send({kMisdirected, "text/plain; charset=utf-8", kForeignHost});
}

void HttpConnection::answer(const Request& request) {
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

void HttpConnection::answer_file(const std::string& path, bool is_get) {
  const PageFile* const file = console_.page.find(path);
  if (file == nullptr) return send(failure(kNotFound, "there is no such page"));
  if (!is_get) return send(method_not_allowed());
  send({200, file->type, file->bytes, console_.page.security_policy()});
}

void HttpConnection::later(std::function<Answer()> work) {
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

void HttpConnection::send(Answer answer) {
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
void HttpConnection::drain() {
  is_idle_ = true;
  buffer_.consume(buffer_.size());
  stream_.expires_after(kDrainWithin);
  stream_.async_read_some(buffer_.prepare(kMaxBody),
                          [self = shared_from_this()](beast::error_code error, std::size_t) {
                            if (!error && ++self->drained_ < kMaxDrained) self->drain();
                          });
}

void HttpConnection::open_client(const Request& request) {
  if (!websocket::is_upgrade(request))
    return send(failure(kUpgradeRequired, "/live is a WebSocket"));
  count_living(console_.clients);  // removes those that have ended
  if (count_clients(console_, Role::kNone) >= kMaxUnknown) {
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

}  // namespace

void TelemetryClient::run(const Request& request) {
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

void TelemetryClient::pump(Clock::time_point now) {
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

std::function<void(beast::error_code, std::size_t)> TelemetryClient::written() {
  return [self = shared_from_this()](beast::error_code error, std::size_t) {
    self->is_writing_ = false;
    if (!error) self->pump(Clock::now());
  };
}

void TelemetryClient::read() {
  socket_.async_read(buffer_, [self = shared_from_this()](beast::error_code error, std::size_t) {
    if (error) return self->on_error(error);
    self->on_message();
  });
}

void TelemetryClient::on_error(beast::error_code error) {
  is_closing_ = true;
  release_hand();
  if (error == websocket::error::message_too_big || error == websocket::error::buffer_overflow)
    console_.log.refused("a WebSocket message that is too long", from_);
  else if (error.category() == beast::error_code(websocket::error::bad_opcode).category() &&
           error != websocket::error::closed)
    console_.log.refused("a malformed WebSocket frame", from_);
}

void TelemetryClient::on_message() {
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

bool TelemetryClient::on_first(const std::string& text) {
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

bool TelemetryClient::on_later(const std::string& text) {
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

bool TelemetryClient::on_hand(const HandRequest& request) {
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

void TelemetryClient::release_hand() {
  if (!console_.hand.let_go(this)) return;
  progress_.forget_hand();
  if (console_.supervisor.has_hand()) console_.supervisor.move_hand(std::nullopt);
}

bool TelemetryClient::has_place() const {
  return count_clients(console_, role_) <=  // with this one
         (role_ == Role::kOperator ? kMaxOperators : kMaxAudience);
}

void TelemetryClient::close(websocket::close_code code) {
  is_closing_ = true;
  release_hand();
  if (is_writing_) return abort();
  socket_.async_close(code, [self = shared_from_this()](beast::error_code) {});
}

void TelemetryClient::abort() {
  beast::error_code ignored;
  is_closing_ = true;
  release_hand();
  beast::get_lowest_layer(socket_).socket().close(ignored);
}

std::size_t count_clients(const ConsoleState& console, Role role) {
  return static_cast<std::size_t>(
      std::count_if(console.clients.begin(), console.clients.end(), [role](const auto& one) {
        const auto client = one.lock();
        return client && client->role() == role;
      }));
}

}  // namespace trocar::runtime
