// SPDX-License-Identifier: Apache-2.0
// One thread does everything, so that answers come in the order of the messages.
#include "tests/stand_ins/haply/server.h"

#include <utility>  // before asio, which uses std::exchange without it

#include <boost/asio.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <deque>
#include <functional>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "tests/stand_ins/haply/http_routes.h"

namespace trocar::haply_stand_in {
namespace {

namespace net = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
namespace websocket = beast::websocket;
using tcp = net::ip::tcp;
using Clock = Service::Clock;

// Limits against hostile clients.
constexpr std::size_t kMaxConnections = 16, kMaxMessage = 65536, kMaxBody = 4096, kMaxQueue = 1000;
constexpr auto kRequestWithin = std::chrono::seconds(10);
constexpr auto kRetryAccept = std::chrono::milliseconds(100);

Clock::duration duration_of(double seconds) {
  return std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(seconds));
}

using Restart = std::function<void(double seconds)>;

/// A client, first of HTTP, and of the WebSocket after its upgrade.
class Connection : public std::enable_shared_from_this<Connection> {
 public:
  Connection(Service& service, tcp::socket socket, const Restart& restart)
      : service_(service),
        restart_(restart),
        stream_(std::move(socket)),
        timer_(stream_.get_executor()) {}

  void read_request() {
    parser_.emplace();
    parser_->body_limit(kMaxBody);
    stream_.expires_after(kRequestWithin);
    http::async_read(stream_, buffer_, *parser_,
                     [self = shared_from_this()](beast::error_code error, std::size_t) {
                       if (!error) self->answer_request();
                     });
  }

  /// Ends the connection at once. `with_reset`: by a TCP reset.
  void abort(bool with_reset) {
    auto& socket = web_ ? beast::get_lowest_layer(*web_).socket() : stream_.socket();
    beast::error_code ignored;
    if (with_reset) socket.set_option(net::socket_base::linger(true, 0), ignored);
    socket.close(ignored);
    end(false);
  }

 private:
  void answer_request() {
    auto request = parser_->release();
    const std::string target(request.target());
    if (websocket::is_upgrade(request) && target == "/") return open_websocket(request);
    const HttpAnswer answer =
        answer_http(service_, std::string(request.method_string()), target, request.body());
    response_ = {http::int_to_status(answer.status), request.version(), answer.body};
    response_.set(http::field::content_type, "application/json");
    response_.keep_alive(request.keep_alive());
    response_.prepare_payload();
    http::async_write(stream_, response_,
                      [self = shared_from_this()](beast::error_code error, std::size_t) {
                        if (error) return;
                        if (self->response_.keep_alive()) return self->read_request();
                        beast::error_code ignored;
                        self->stream_.socket().shutdown(tcp::socket::shutdown_send, ignored);
                      });
  }

  void open_websocket(const http::request<http::string_body>& request) {
    stream_.expires_never();
    web_.emplace(std::move(stream_));
    web_->set_option(
        websocket::stream_base::timeout{kRequestWithin, websocket::stream_base::none(), false});
    web_->read_message_max(kMaxMessage);
    web_->auto_fragment(false);
    web_->async_accept(request, [self = shared_from_this()](beast::error_code error) {
      if (error) return;
      Answer inventory;
      self->session_ = self->service_.begin_session(inventory);
      self->act(inventory);
      self->read_message();
    });
  }

  void read_message() {
    web_->async_read(buffer_, [self = shared_from_this()](beast::error_code error, std::size_t) {
      if (error) {
        const bool has_left = error == websocket::error::closed || error == net::error::eof ||
                              error == net::error::operation_aborted ||
                              error == net::error::connection_reset;
        return self->end(!has_left);
      }
      const auto bytes = self->buffer_.cdata();
      const Answer answer = self->service_.receive(
          self->session_, {static_cast<const char*>(bytes.data()), bytes.size()});
      self->buffer_.consume(bytes.size());
      self->act(answer);
      if (self->session_ != 0) self->read_message();
    });
  }

  void act(const Answer& answer) {
    switch (answer.act) {
      case Act::kStaySilent:
        return;
      case Act::kReset:
        return abort(true);
      case Act::kRestart:
        return restart_(answer.restart_s);
      case Act::kClose:
        is_closing_ = true;
        queue_.clear();
        return web_->async_close(websocket::close_code::going_away,
                                 [self = shared_from_this()](beast::error_code) {});
      case Act::kSend:
        break;
    }
    if (is_closing_) return;
    const auto due = Clock::now() + duration_of(answer.delay_s);
    for (int copy = 0; copy < answer.copies; ++copy)
      queue_.push_back({answer.bytes, answer.is_binary, due});
    if (queue_.size() > kMaxQueue) return abort(false);  // it does not read
    send();
  }

  void send() {
    if (is_sending_ || is_closing_ || queue_.empty()) return;
    is_sending_ = true;
    if (queue_.front().due > Clock::now()) {
      timer_.expires_at(queue_.front().due);
      timer_.async_wait([self = shared_from_this()](beast::error_code) {
        self->is_sending_ = false;
        if (self->session_ != 0) self->send();
      });
      return;
    }
    sent_ = std::move(queue_.front());
    queue_.pop_front();
    web_->binary(sent_.is_binary);
    web_->async_write(net::buffer(sent_.bytes),
                      [self = shared_from_this()](beast::error_code error, std::size_t) {
                        self->is_sending_ = false;
                        if (!error && self->session_ != 0) self->send();
                      });
  }

  void end(bool by_protocol_error) {
    if (session_ == 0) return;
    service_.end_session(session_, by_protocol_error);
    session_ = 0;
    timer_.cancel();
  }

  struct Queued {
    std::string bytes;
    bool is_binary = false;
    Clock::time_point due;
  };

  Service& service_;
  const Restart& restart_;
  beast::tcp_stream stream_;
  std::optional<websocket::stream<beast::tcp_stream>> web_;
  net::steady_timer timer_;
  beast::flat_buffer buffer_;
  std::optional<http::request_parser<http::string_body>> parser_;
  http::response<http::string_body> response_;
  int session_ = 0;  // 0: none, or no longer
  bool is_sending_ = false, is_closing_ = false;
  std::deque<Queued> queue_;
  Queued sent_;
};

class Server {
 public:
  Server(net::io_context& context, Service& service, std::uint16_t port)
      : context_(context), service_(service), acceptor_(context), timer_(context) {
    endpoint_ = {net::ip::address_v4::loopback(), port};
    restart_ = [this](double seconds) { restart(seconds); };
    const beast::error_code error = listen();
    if (error) throw std::runtime_error("port " + std::to_string(port) + ": " + error.message());
  }

  std::uint16_t port() const { return endpoint_.port(); }

 private:
  beast::error_code listen() {
    beast::error_code error;
    acceptor_.open(endpoint_.protocol(), error);
    if (!error) acceptor_.set_option(net::socket_base::reuse_address(true), error);
    if (!error) acceptor_.bind(endpoint_, error);
    if (!error) acceptor_.listen(net::socket_base::max_listen_connections, error);
    if (error) return error;
    endpoint_ = acceptor_.local_endpoint();  // the same port again after a restart
    accept();
    return error;
  }

  void accept() {
    acceptor_.async_accept([this](beast::error_code error, tcp::socket socket) {
      if (error == net::error::operation_aborted) return;
      if (error) {  // no free descriptors
        timer_.expires_after(kRetryAccept);
        return timer_.async_wait([this](beast::error_code late) {
          if (!late) accept();
        });
      }
      socket.set_option(tcp::no_delay(true), error);
      std::erase_if(connections_, [](const auto& one) { return one.expired(); });
      if (connections_.size() < kMaxConnections) {
        const auto connection = std::make_shared<Connection>(service_, std::move(socket), restart_);
        connections_.push_back(connection);
        connection->read_request();
      }
      accept();
    });
  }

  void restart(double seconds) {
    beast::error_code ignored;
    acceptor_.close(ignored);
    for (const auto& one : std::exchange(connections_, {}))
      if (const auto connection = one.lock()) connection->abort(false);
    timer_.expires_after(duration_of(seconds));
    timer_.async_wait([this](beast::error_code late) {
      if (late) return;
      const beast::error_code error = listen();
      if (!error) return;
      std::fprintf(stderr, "cannot listen again: %s\n", error.message().c_str());
      context_.stop();
    });
  }

  net::io_context& context_;
  Service& service_;
  tcp::acceptor acceptor_;
  tcp::endpoint endpoint_;
  net::steady_timer timer_;
  Restart restart_;
  std::vector<std::weak_ptr<Connection>> connections_;
};

}  // namespace

void serve(Service& service, std::uint16_t port, std::optional<double> duration_s) {
  net::io_context context(1);
  Server server(context, service, port);
  net::signal_set signals(context, SIGINT, SIGTERM);
  signals.async_wait([&](beast::error_code, int) { context.stop(); });
  net::steady_timer timer(context);
  if (duration_s) {
    timer.expires_after(duration_of(*duration_s));
    timer.async_wait([&](beast::error_code) { context.stop(); });
  }
  std::printf("listening on %u\n", static_cast<unsigned>(server.port()));
  std::fflush(stdout);
  context.run();
}

}  // namespace trocar::haply_stand_in
