// SPDX-License-Identifier: Apache-2.0
#include "runtime/device/pose/haply.h"

#include <gtest/gtest.h>

#include <atomic>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/write.hpp>
#include <boost/beast/core/buffers_to_string.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/websocket/stream.hpp>
#include <functional>
#include <limits>
#include <nlohmann/json.hpp>
#include <thread>
#include <utility>
#include <vector>

#include "tests/runtime/device/pose/haply_texts.h"

namespace trocar::runtime {
namespace {

namespace net = boost::asio;
namespace beast = boost::beast;
namespace websocket = beast::websocket;
using tcp = net::ip::tcp;
using boost::system::error_code;
using nlohmann::json;
using SteadyClock = std::chrono::steady_clock;
using ServerSocket = websocket::stream<tcp::socket>;

/// Serves one connection after the other, on a port of its own.
class Server {
 public:
  using Serve = std::function<void(tcp::socket)>;
  explicit Server(Serve serve, std::uint16_t port = 0)
      : acceptor_(context_, {net::ip::address_v4::loopback(), port}), serve_(std::move(serve)) {
    thread_ = std::thread([this] {
      while (!is_ending_) {
        error_code error;
        tcp::socket socket(context_);
        acceptor_.accept(socket, error);
        if (!error && !is_ending_) serve_(std::move(socket));
      }
    });
  }
  /// Clients must have closed their connections.
  ~Server() {
    is_ending_ = true;
    error_code ignored;
    tcp::socket(context_).connect(acceptor_.local_endpoint(), ignored);  // wakes accept()
    thread_.join();
  }
  std::uint16_t port() const { return acceptor_.local_endpoint().port(); }

 private:
  net::io_context context_;
  tcp::acceptor acceptor_;
  Serve serve_;
  std::atomic<bool> is_ending_{false};
  std::thread thread_;
};

/// Returns the messages to send after message number n; after the connection begins, n is 0.
using Answers = std::function<std::vector<std::string>(int n, const std::string& message)>;

/// Serves as the service does, and keeps what it received.
class Service {
 public:
  explicit Service(Answers answers, std::uint16_t port = 0)
      : answers_(std::move(answers)),
        server_([this](tcp::socket socket) { serve(std::move(socket)); }, port) {}
  std::uint16_t port() const { return server_.port(); }
  /// Call it only after the client has closed.
  std::vector<std::string>& received() {
    while (is_serving_)
      std::this_thread::yield();
    return received_;
  }
  bool was_closed_properly() { return received(), was_closed_properly_; }

 private:
  void serve(tcp::socket raw) {
    is_serving_ = true;
    ServerSocket socket(std::move(raw));
    error_code error;
    socket.accept(error);
    std::string message;
    for (int n = 0; !error; ++n) {
      for (const std::string& answer : answers_(n, message)) {
        if (answer == "CLOSE") {
          socket.close(websocket::close_code::going_away, error);
        } else if (answer == "RESET") {
          socket.next_layer().set_option(net::socket_base::linger(true, 0), error);
          socket.next_layer().close(error);
          error = net::error::connection_aborted;
        } else {
          socket.write(net::buffer(answer), error);
        }
      }
      beast::flat_buffer buffer;
      if (!error) socket.read(buffer, error);
      message = beast::buffers_to_string(buffer.data());
      if (!error) received_.push_back(message);
    }
    was_closed_properly_ = error == websocket::error::closed;
    is_serving_ = false;
  }

  Answers answers_;
  std::vector<std::string> received_;
  bool was_closed_properly_ = false;
  std::atomic<bool> is_serving_{false};
  Server server_;
};

Answers with(const std::string& inventory, const std::string& update) {
  return [=](int n, const std::string&) -> std::vector<std::string> {
    return {n == 0 ? inventory : update};
  };
}

struct Client {
  explicit Client(std::uint16_t port, bool wants_rotation = false) : options{} {
    options.address.endpoint.port = port;
    options.say = [this](const std::string& line) { lines.push_back(line); };
    options.wants_rotation = wants_rotation;
    options.open_timeout_s = 0.6;
    uri = "haply:localhost:" + std::to_string(port) + ": ";
    connection = std::make_unique<HaplyConnection>(options);
  }
  /// True if a line was said that contains the text.
  bool said(const std::string& text) const {
    for (const std::string& line : lines)
      if (line.rfind(uri, 0) == 0 && line.find(text) != std::string::npos) return true;
    return false;
  }
  /// Expects an error that begins with the URI and contains the text.
  template <typename Result>
  void expect_error(const Result& result, const std::string& text) const {
    ASSERT_FALSE(result);
    EXPECT_EQ(result.error().code, ExitCode::kDeviceFault);
    EXPECT_EQ(result.error().message.rfind(uri, 0), 0U) << result.error().message;
    EXPECT_NE(result.error().message.find(text), std::string::npos) << result.error().message;
    EXPECT_EQ(result.error().message.find('\n'), std::string::npos);
  }

  HaplyOptions options;
  std::string uri;
  std::vector<std::string> lines;
  std::unique_ptr<HaplyConnection> connection;
};

double seconds_of(const std::function<void()>& work) {
  const auto start = SteadyClock::now();
  work();
  return std::chrono::duration<double>(SteadyClock::now() - start).count();
}

std::string force_of(const std::string& message, const char* spelling) {
  const json command = json::parse(message)["inverse3"][0]["commands"]["set_cursor_force"];
  return command.size() == 1 ? command[spelling].dump() : "not one form";
}

TEST(HaplyConnection, Addresses) {
  const auto standard = parse_haply_address("");
  ASSERT_TRUE(standard);
  EXPECT_EQ(standard->host, "localhost");
  EXPECT_EQ(standard->endpoint, (Endpoint{0x7f000001, 10001}));
  const auto host = parse_haply_address("127.0.0.2");
  ASSERT_TRUE(host);
  EXPECT_EQ(host->endpoint, (Endpoint{0x7f000002, 10001}));
  const auto full = parse_haply_address("localhost:8500");
  ASSERT_TRUE(full);
  EXPECT_EQ(full->host, "localhost");
  EXPECT_EQ(full->endpoint, (Endpoint{0x7f000001, 8500}));
  for (const char* const wrong : {":", ":10001", "localhost:", "localhost:0", "localhost:65536",
                                  "localhost:1x", "a b", "::1", "a/b:1", "127.0.0.1\r\nX: y"}) {
    const auto address = parse_haply_address(wrong);
    ASSERT_FALSE(address) << wrong;
    EXPECT_EQ(address.error().code, ExitCode::kUsage);
    EXPECT_EQ(address.error().message.rfind(std::string("haply:") + wrong + ": ", 0), 0U)
        << address.error().message;
  }
}

TEST(HaplyConnection, SessionWith35) {
  Service service(with(kInventory35, kUpdate35));
  {
    Client client(service.port(), true);
    ASSERT_TRUE(client.connection->open());
    EXPECT_TRUE(client.connection->senses_rotation());
    EXPECT_TRUE(
        client.said("device 049D (inverse3, right-handed) was found, with VerseGrip 61548"));
    EXPECT_TRUE(client.said("force_gate, with gain 0.3"));
    EXPECT_EQ(client.lines.size(), 2U);
    double t_s = 0;
    for (int i = 0; i < 100; ++i) {
      const auto reading = client.connection->exchange({0.1, i / 3.0, -1e-7, 9, 9, 9});
      ASSERT_TRUE(reading) << reading.error().message;
      EXPECT_GT(reading->t_s, t_s);
      t_s = reading->t_s;
      EXPECT_EQ(reading->p_m, (std::array{0.0125, -0.12, 0.15}));
      EXPECT_EQ(reading->q, (std::array{0.8, 0.6, 0.0, 0.0}));
      EXPECT_EQ(reading->buttons, 1U);
    }
    client.connection->close();
  }
  const auto& received = service.received();
  ASSERT_EQ(received.size(), 102U);  // one of open(), one of close()
  EXPECT_TRUE(service.was_closed_properly());
  EXPECT_EQ(force_of(received.front(), "vector"), R"({"x":0,"y":0,"z":0})");
  EXPECT_EQ(force_of(received.back(), "vector"), R"({"x":0,"y":0,"z":0})");
  for (int i = 0; i < 100; ++i) {
    const json message = json::parse(received[static_cast<std::size_t>(i) + 1]);
    EXPECT_EQ(message["inverse3"][0]["device_id"], "049D");
    const json& vector = message["inverse3"][0]["commands"]["set_cursor_force"]["vector"];
    EXPECT_EQ(vector["x"].get<double>(), 0.1);
    EXPECT_EQ(vector["y"].get<double>(), i / 3.0);
    EXPECT_EQ(vector["z"].get<double>(), -1e-7);
  }
}

TEST(HaplyConnection, SessionWith31) {
  Service service(with(kInventory31, kUpdate31));
  {
    Client client(service.port());
    ASSERT_TRUE(client.connection->open());
    EXPECT_FALSE(client.connection->senses_rotation());
    EXPECT_TRUE(client.said("device 04BA (inverse3, left-handed) was found, without a VerseGrip"));
    EXPECT_TRUE(client.said("device 04BA is set up for the left hand"));
    EXPECT_TRUE(client.said("device M1 (minverse) is connected too; it is not used"));
    EXPECT_EQ(client.lines.size(), 3U);
    const auto reading = client.connection->exchange({1, 2, 3, 0, 0, 0});
    ASSERT_TRUE(reading) << reading.error().message;
    EXPECT_EQ(reading->p_m, (std::array{0.01, 0.02, -0.03}));
  }
  ASSERT_EQ(service.received().size(), 3U);
  EXPECT_EQ(force_of(service.received()[1], "values"), R"({"x":1,"y":2,"z":3})");
  EXPECT_EQ(force_of(service.received()[2], "values"), R"({"x":0,"y":0,"z":0})");
}

TEST(HaplyConnection, UnknownVersionGetsBothForms) {
  const std::string text =
      R"({"inverse3":[{"device_id":"A","state":{"cursor_position":{"x":0,"y":0,"z":0}}}]})";
  Service service(with(text, text));
  {
    Client client(service.port());
    ASSERT_TRUE(client.connection->open());
    EXPECT_TRUE(client.said("does not show the version of its protocol"));
  }
  const json message = json::parse(service.received().front());
  EXPECT_EQ(message["inverse3"][0]["commands"]["set_cursor_force"].size(), 2U);
}

TEST(HaplyConnection, AnotherServerOrAMuteOneListens) {
  for (const char* answer : {"HTTP/1.0 404 Not Found\r\n\r\n", ""}) {
    const Server server([answer](tcp::socket socket) {
      error_code ignored;
      if (*answer != '\0') net::write(socket, net::buffer(std::string(answer)), ignored);
      std::array<char, 4096> request{};
      while (!ignored)
        socket.read_some(net::buffer(request), ignored);
    });
    Client client(server.port());
    EXPECT_LT(seconds_of([&] {
                client.expect_error(client.connection->open(),
                                    "not answer like the Haply Inverse service");
                client.connection->close();
              }),
              5);
  }
}

TEST(HaplyConnection, OtherProtocolsAreRefused) {
  for (const auto& [first, complaint] :
       {std::pair<std::string, std::string>{"welcome", "does not speak version 3.1 or 3.5"},
        {R"({"devices":[]})", "does not speak version 3.1 or 3.5"},
        {"CLOSE", "the service closed the connection"},
        {"RESET", "was lost"},
        {std::string(kMaxHaplyMessageBytes + 1, ' '), "more than 256 kB"}}) {
    Service service([&first = first](int, const std::string&) { return std::vector{first}; });
    Client client(service.port());
    client.expect_error(client.connection->open(), complaint);
  }
}

TEST(HaplyConnection, WaitsUntilTheDevicesAreReady) {
  std::string cold = kInventory35;
  cold.replace(cold.find("\"calibrated\":true"), 17, "\"calibrated\":false");
  Service service([&](int n, const std::string&) -> std::vector<std::string> {
    return {n == 0 ? "{}" : n == 1 ? cold : n == 2 ? kInventory35 : kUpdate35};
  });
  {
    Client client(service.port(), true);
    ASSERT_TRUE(client.connection->open());
    EXPECT_TRUE(client.said("no Inverse3 is connected"));
    EXPECT_TRUE(client.said("device 049D is not calibrated"));
  }
  EXPECT_EQ(service.received()[0], haply_inventory_request());
  EXPECT_EQ(service.received()[1], haply_inventory_request());
}

TEST(HaplyConnection, StatesDoNotGrowOldInTheBuffers) {
  // Each answer comes twice; the second one of each would be an old state later.
  Service service([](int n, const std::string&) -> std::vector<std::string> {
    if (n == 0) return {kInventory31};
    std::string update = kUpdate31;
    update.replace(update.find("0.01"), 4, "0.0" + std::to_string(100 + n));
    return {update, update};
  });
  Client client(service.port());
  ASSERT_TRUE(client.connection->open());
  for (int n = 2; n < 12; ++n) {
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    const auto reading = client.connection->exchange({});
    ASSERT_TRUE(reading) << reading.error().message;
    EXPECT_NEAR(reading->p_m[0], 1e-4 * (100 + n), 1.1e-4);  // at most one message behind
  }
}

TEST(HaplyConnection, OpensAgainAfterARestart) {
  auto service = std::make_unique<Service>([](int n, const std::string&) {
    return std::vector<std::string>{n == 0 ? kInventory35 : n < 4 ? kUpdate35 : "RESET"};
  });
  const std::uint16_t port = service->port();
  Client client(port);
  ASSERT_TRUE(client.connection->open());
  ASSERT_TRUE(client.connection->exchange({}));
  ASSERT_TRUE(client.connection->exchange({}));
  ASSERT_FALSE(client.connection->exchange({}));
  client.connection->close();
  service.reset();
  client.expect_error(client.connection->open(), "nothing listens there");
  const std::size_t lines = client.lines.size();

  // The first device of the new service is another one; the session goes on with its own.
  std::string inventory = kInventory35;
  inventory.insert(inventory.find("{\"device_id\":\"049D\""), R"({"device_id":"0000"},)");
  Service again(
      [&](int n, const std::string&) {
        return std::vector<std::string>{n == 0 ? inventory : kUpdate35};
      },
      port);
  const auto opened = client.connection->open();
  ASSERT_TRUE(opened) << opened.error().message;
  EXPECT_TRUE(client.connection->exchange({}));
  EXPECT_EQ(client.lines.size(), lines);
  client.connection->close();
  EXPECT_EQ(json::parse(again.received().back())["inverse3"][0]["device_id"], "049D");
}

TEST(HaplyConnection, AForceThatIsNotFiniteIsNotSent) {
  Service service(with(kInventory35, kUpdate35));
  {
    Client client(service.port());
    ASSERT_TRUE(client.connection->open());
    client.expect_error(
        client.connection->exchange({0, std::numeric_limits<double>::quiet_NaN(), 0, 0, 0, 0}),
        "the commanded force is not finite");
  }
  ASSERT_EQ(service.received().size(), 2U);
}

}  // namespace
}  // namespace trocar::runtime
