// SPDX-License-Identifier: Apache-2.0
#include "runtime/console/telemetry_client.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>

#include "formats/base/json.h"

namespace trocar::runtime {
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
