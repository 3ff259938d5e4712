// SPDX-License-Identifier: Apache-2.0
#include "runtime/console/http_connection.h"

#include <chrono>
#include <utility>

#include "runtime/console/telemetry_client.h"

namespace trocar::runtime {
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

}  // namespace trocar::runtime
