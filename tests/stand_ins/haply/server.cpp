// SPDX-License-Identifier: Apache-2.0
// A stand-in for the service of the Haply Inverse3 arm, for tests and for trying a session without the arm. It is
// written from the public description of the protocol alone. One thread does everything, so that answers come in the
// order of the messages.
#include <sched.h>

#include <utility>  // before asio, which uses std::exchange without it

#include <CLI/CLI.hpp>
#include <boost/asio.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/websocket.hpp>
#include <chrono>
#include <cstdio>
#include <deque>
#include <exception>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "tests/stand_ins/haply/service.h"

namespace stand_in {
namespace {

namespace net = boost::asio;
namespace beast = boost::beast;
namespace websocket = beast::websocket;
using tcp = net::ip::tcp;
using Clock = Service::Clock;

constexpr std::size_t kMaxMessage = 65536;

Clock::duration duration_of(double seconds) {
  return std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(seconds));
}

using Restart = std::function<void(double seconds)>;

class Client : public std::enable_shared_from_this<Client> {
 public:
  Client(Service& service, tcp::socket socket, const Restart& restart)
      : service_(service),
        restart_(restart),
        web_(std::move(socket)),
        timer_(web_.get_executor()) {}

  void start() {
    web_.read_message_max(kMaxMessage);
    web_.auto_fragment(false);
    web_.async_accept([self = shared_from_this()](beast::error_code error) {
      if (error) return;
      Answer inventory;
      self->session_ = self->service_.begin_session(inventory);
      self->act(inventory);
      self->read_message();
    });
  }

  /// Ends the connection at once. `with_reset`: by a TCP reset.
  void abort(bool with_reset) {
    auto& socket = web_.next_layer();
    beast::error_code ignored;
    if (with_reset) socket.set_option(net::socket_base::linger(true, 0), ignored);
    socket.close(ignored);
    end();
  }

 private:
  void read_message() {
    web_.async_read(buffer_, [self = shared_from_this()](beast::error_code error, std::size_t) {
      if (error) return self->end();
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
        return web_.async_close(websocket::close_code::going_away,
                                [self = shared_from_this()](beast::error_code) {});
      case Act::kSend:
        break;
    }
    if (is_closing_) return;
    const auto due = Clock::now() + duration_of(answer.delay_s);
    for (int copy = 0; copy < answer.copies; ++copy)
      queue_.push_back({answer.bytes, answer.is_binary, due});
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
    web_.binary(sent_.is_binary);
    web_.async_write(net::buffer(sent_.bytes),
                     [self = shared_from_this()](beast::error_code error, std::size_t) {
                       self->is_sending_ = false;
                       if (!error && self->session_ != 0) self->send();
                     });
  }

  void end() {
    if (session_ == 0) return;
    service_.end_session(session_);
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
  websocket::stream<tcp::socket> web_;
  net::steady_timer timer_;
  beast::flat_buffer buffer_;
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
      if (error) return;
      socket.set_option(tcp::no_delay(true), error);
      std::erase_if(clients_, [](const auto& one) { return one.expired(); });
      const auto client = std::make_shared<Client>(service_, std::move(socket), restart_);
      clients_.push_back(client);
      client->start();
      accept();
    });
  }

  void restart(double seconds) {
    beast::error_code ignored;
    acceptor_.close(ignored);
    for (const auto& one : std::exchange(clients_, {}))
      if (const auto client = one.lock()) client->abort(false);
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
  std::vector<std::weak_ptr<Client>> clients_;
};

void serve(Service& service, std::uint16_t port, double duration_s) {
  net::io_context context(1);
  Server server(context, service, port);
  net::signal_set signals(context, SIGINT, SIGTERM);
  signals.async_wait([&](beast::error_code, int) { context.stop(); });
  net::steady_timer timer(context, duration_of(duration_s));
  timer.async_wait([&](beast::error_code) { context.stop(); });
  std::printf("listening on %u\n", static_cast<unsigned>(server.port()));
  std::fflush(stdout);
  context.run();
}

struct CommandLine {
  ServiceSettings service;
  std::uint16_t port = 10001;
  double duration_s = 1e6;
  std::optional<double> force_gate;
  std::string grip = "none", path, faults, readings;
};

void declare(CLI::App& app, CommandLine& line) {
  ServiceSettings& service = line.service;
  app.add_option("--port", line.port, "Port on 127.0.0.1; 0: any free one")->capture_default_str();
  app.add_option("--duration", line.duration_s, "End after this many seconds")
      ->check(CLI::Range(0.0, 1e6));
  app.add_option("--protocol", service.protocol, "Version: 3.1 or 3.5 (default)")
      ->transform(CLI::Transformer(
          std::map<std::string, Protocol>{{"3.1", Protocol::kV31}, {"3.5", Protocol::kV35}}));
  app.add_option("--grip", line.grip, "none or verse_grip")
      ->check(CLI::IsMember({"none", "verse_grip"}))
      ->capture_default_str();
  app.add_option("--force-gate", line.force_gate,
                 "Gain of the force filter, from 0 (off) to less than 1; only with version 3.5 "
                 "(default 0.3)")
      ->check(CLI::Range(0.0, 0.999));
  app.add_option("--path", line.path, "Keyframes of the hand (JSON)");
  app.add_option("--hand-stiffness", service.arm.hand_stiffness_N_per_m, "N/m")
      ->check(CLI::Range(0.0, 1e5))
      ->capture_default_str();
  app.add_option("--hand-damping", service.arm.hand_damping_N_s_per_m, "N*s/m")
      ->check(CLI::Range(0.0, 1e4))
      ->capture_default_str();
  app.add_option("--readings", line.readings,
                 "NOISE:STEP:LATE in m, m and s: standard deviation and step of positions, and the "
                 "longest time by which an answer is late");
  app.add_option("--log", service.log, "Write all forces to this CSV file");
  app.add_option("--summary", service.summary, "Write counts to this JSON file at the end");
  app.add_option("--fault", line.faults,
                 "KIND@SECONDS[:DURATION],..., after the first force; without DURATION for one "
                 "answer");
  std::string kinds = "Kinds of faults:\n";
  for (const auto& [name, meaning] : kFaultKinds)
    kinds.append("  ").append(name).append(": ").append(meaning).append("\n");
  app.footer(kinds);
}

void run(CommandLine& line) {
  ServiceSettings& service = line.service;
  const bool is_new = service.protocol == Protocol::kV35;
  if (line.force_gate && !is_new)
    throw std::runtime_error("--force-gate needs --protocol 3.5: version 3.1 states no filters");
  service.force_gate_gain = is_new ? line.force_gate.value_or(0.3) : 0;
  service.has_grip = line.grip == "verse_grip";
  service.path = {{0, {0, -0.12, 0.15}, Eigen::Vector3d::Zero(), 0}};
  if (!line.path.empty()) service.path = read_path(line.path);
  if (!line.readings.empty()) service.readings = Readings(line.readings);
  std::vector<std::string_view> kinds;
  kinds.reserve(std::size(kFaultKinds));
  for (const auto& kind : kFaultKinds)
    kinds.push_back(kind[0]);
  service.faults = parse_faults(line.faults, kinds);
  Service running(service);
  // A real service waits for nobody, so the stand-in takes realtime priority if it may.
  sched_param priority{};
  priority.sched_priority = 70;
  static_cast<void>(::sched_setscheduler(0, SCHED_FIFO, &priority));
  serve(running, line.port, line.duration_s);
  running.finish();
}

}  // namespace
}  // namespace stand_in

int main(int argc, char** argv) {
  CLI::App app("Stand-in for the service of the Haply Inverse3 arm");
  stand_in::CommandLine line;
  stand_in::declare(app, line);
  CLI11_PARSE(app, argc, argv);
  try {
    stand_in::run(line);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 2;
  }
  return 0;
}
