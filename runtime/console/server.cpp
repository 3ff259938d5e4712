// SPDX-License-Identifier: Apache-2.0
#include "runtime/console/server.h"

#include <csignal>
#include <cstdio>
#include <sstream>

#include "formats/base/text.h"
#include "runtime/console/connections.h"

namespace trocar::runtime {
namespace {

using SteadyClock = std::chrono::steady_clock;

constexpr std::size_t kMaxConnections = 64;
// The period of polling is short, because a client gets a snapshot as soon as it has been read.
constexpr auto kPollEvery = std::chrono::milliseconds(2), kPollIdle = std::chrono::milliseconds(25);
constexpr auto kRetryAccept = std::chrono::milliseconds(100);
constexpr auto kEndWithin = std::chrono::seconds(10);

// An IPv6 address stands in brackets.
std::string text_of(const tcp::endpoint& endpoint) {
  return (std::ostringstream() << endpoint).str();
}

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
