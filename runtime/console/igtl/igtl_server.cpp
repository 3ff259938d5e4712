// SPDX-License-Identifier: Apache-2.0
#include "runtime/console/igtl/igtl_server.h"

#include <linux/sockios.h>
#include <sys/ioctl.h>

#include <algorithm>
#include <array>
#include <boost/asio.hpp>
#include <sstream>
#include <utility>
#include <vector>

#include "runtime/console/igtl/igtl_request.h"

namespace trocar::runtime {
namespace {

namespace net = boost::asio;
using tcp = net::ip::tcp;
using ErrorCode = boost::system::error_code;
using SteadyClock = IgtlServer::Clock;

constexpr std::size_t kMaxClients = 8;
constexpr int kMaxMessagesInSecond = 200;
constexpr std::size_t kMaxBytesInSecond = std::size_t{1} << 20;
constexpr int kIgtlSendBuffer = 65536;
// A pose is left out while more bytes than these wait in the system for a client, so that it gets no old
// ones. They are about 15 poses.
constexpr int kMaxWaiting = 4096;
constexpr std::size_t kWriteStep = 65536;
constexpr auto kPosePeriod = std::chrono::microseconds(16'667);
constexpr auto kSurfacePeriod = std::chrono::seconds(1);
constexpr auto kIgtlStalled = std::chrono::seconds(6);
constexpr auto kAcceptAgainAfter = std::chrono::milliseconds(100);

// An IPv6 address stands in brackets.
std::string address_of(const tcp::endpoint& endpoint) {
  return (std::ostringstream() << endpoint).str();
}

/// One client.
class Client : public std::enable_shared_from_this<Client> {
 public:
  Client(tcp::socket socket, std::string from, const IgtlServer::Refused& refused)
      : socket_(std::move(socket)), from_(std::move(from)), refused_(refused) {}

  void read_header() {
    net::async_read(socket_, net::buffer(header_bytes_),
                    [self = shared_from_this()](ErrorCode error, std::size_t) {
                      if (error) return self->close();
                      self->on_header();
                    });
  }

  void pump(const IgtlState& state, SteadyClock::time_point now) {
    if (is_closed_) return;
    if (!writing_.empty()) {
      if (now - progress_at_ > kIgtlStalled) close();
      return;
    }
    // A client that takes no more poses has stopped reading, although nothing is being written to it.
    if (waiting() <= kMaxWaiting) {
      progress_at_ = now;
    } else if (now - progress_at_ > kIgtlStalled) {
      return close();
    }
    if (session_ != state.session) {
      session_ = state.session;
      status_ = tick_ = 0;
      wants_surface_ = true;
    }
    if (state.status && status_ != state.status_number) {
      status_ = state.status_number;
      writing_.push_back(state.status);
    }
    if (state.surface && wants_surface_ && now >= surface_due_) {
      wants_surface_ = false;
      surface_due_ = now + kSurfacePeriod;
      writing_.push_back(state.surface);
    }
    if (state.tick && tick_ != state.tick_number && now >= pose_due_ && waiting() <= kMaxWaiting) {
      tick_ = state.tick_number;
      pose_due_ = std::max<SteadyClock::time_point>(pose_due_ + kPosePeriod, now);
      writing_.push_back(state.tick);
    }
    if (!writing_.empty()) write(now);
  }

  void close() {
    ErrorCode ignored;
    is_closed_ = true;
    socket_.close(ignored);
  }

  bool is_closed() const { return is_closed_; }

 private:
  /// Number of bytes that have been written and have not reached the client.
  int waiting() {
    int bytes = 0;
    ::ioctl(socket_.native_handle(), SIOCOUTQ, &bytes);  // NOLINT(*-vararg): the system's interface
    return bytes;
  }

  void refuse(const char* kind) {
    refused_(kind, from_);
    close();
  }

  void on_header() {
    const auto header = read_igtl_header(header_bytes_);
    if (!header) return refuse("a malformed OpenIGTLink header");
    const auto now = SteadyClock::now();
    if (now - second_from_ >= std::chrono::seconds(1)) {
      second_from_ = now;
      messages_in_second_ = 0;
      bytes_in_second_ = 0;
    }
    bytes_in_second_ += header->body_bytes;
    if (++messages_in_second_ > kMaxMessagesInSecond || bytes_in_second_ > kMaxBytesInSecond)
      return refuse("an OpenIGTLink client that sends too much");
    header_ = *header;
    body_.resize(header_.body_bytes);
    net::async_read(socket_, net::buffer(body_),
                    [self = shared_from_this()](ErrorCode error, std::size_t) {
                      if (error) return self->close();
                      self->on_body();
                    });
  }

  void on_body() {
    if (!is_igtl_body(header_, body_)) return refuse("a malformed OpenIGTLink message");
    if (header_.type == "GET_POLYDATA") wants_surface_ = true;
    if (header_.type == "GET_STATUS") status_ = 0;
    read_header();  // all other messages are ignored
  }

  void write(SteadyClock::time_point now) {
    progress_at_ = now;
    std::vector<net::const_buffer> buffers;
    for (const IgtlBytes& bytes : writing_)
      buffers.push_back(net::buffer(*bytes));
    const auto self = shared_from_this();
    net::async_write(
        socket_, buffers,
        [self](ErrorCode error, std::size_t) {
          self->progress_at_ = SteadyClock::now();
          return error ? std::size_t{0} : kWriteStep;
        },
        [self](ErrorCode error, std::size_t) {
          self->writing_.clear();
          if (error) self->close();
        });
  }

  tcp::socket socket_;
  std::string from_;
  const IgtlServer::Refused& refused_;
  bool is_closed_ = false, wants_surface_ = true;
  std::array<std::uint8_t, kIgtlHeaderBytes> header_bytes_{};
  IgtlHeader header_;
  std::vector<std::uint8_t> body_;
  int messages_in_second_ = 0;
  std::size_t bytes_in_second_ = 0;
  std::vector<IgtlBytes> writing_;  ///< messages that are being sent
  std::uint64_t session_ = 0, status_ = 0, tick_ = 0;
  SteadyClock::time_point second_from_, progress_at_, pose_due_, surface_due_;
};

class TcpServer : public IgtlServer {
 public:
  TcpServer(tcp::acceptor acceptor, Refused refused)
      : acceptor_(std::move(acceptor)),
        retry_(acceptor_.get_executor()),
        refused_(std::move(refused)) {
    accept();
  }

  std::string endpoint() const override {
    ErrorCode ignored;
    return address_of(acceptor_.local_endpoint(ignored));
  }
  bool has_clients() const override { return !clients_.empty(); }

  void pump(const IgtlState& state, SteadyClock::time_point now) override {
    for (const auto& client : clients_)
      client->pump(state, now);
    remove_closed();
  }

 private:
  void accept() {
    acceptor_.async_accept([this](ErrorCode error, tcp::socket socket) {
      if (error == net::error::operation_aborted) return;
      if (!error) {
        open(std::move(socket));
        return accept();
      }
      // The process has no free descriptors. They become free when connections end.
      retry_.expires_after(kAcceptAgainAfter);
      retry_.async_wait([this](ErrorCode aborted) {
        if (!aborted) accept();
      });
    });
  }

  void open(tcp::socket socket) {
    ErrorCode error;
    const tcp::endpoint peer = socket.remote_endpoint(error);
    if (error) return;
    remove_closed();
    if (clients_.size() >= kMaxClients)
      return refused_("an OpenIGTLink client beyond 8", address_of(peer));
    socket.set_option(tcp::no_delay(true), error);
    socket.set_option(net::socket_base::send_buffer_size(kIgtlSendBuffer), error);
    clients_.push_back(std::make_shared<Client>(std::move(socket), address_of(peer), refused_));
    clients_.back()->read_header();
  }

  void remove_closed() {
    std::erase_if(clients_, [](const auto& client) { return client->is_closed(); });
  }

  tcp::acceptor acceptor_;
  net::steady_timer retry_;
  Refused refused_;
  std::vector<std::shared_ptr<Client>> clients_;
};

}  // namespace

Result<std::unique_ptr<IgtlServer>> IgtlServer::listen(net::io_context& context,
                                                       const IgtlAddress& address,
                                                       Refused refused) {
  ErrorCode error;
  const tcp::endpoint endpoint(net::ip::make_address(address.address, error), address.port);
  tcp::acceptor acceptor(context);
  if (!error) acceptor.open(endpoint.protocol(), error);
  if (!error) acceptor.set_option(net::socket_base::reuse_address(true), error);
  if (!error) acceptor.bind(endpoint, error);
  if (!error) acceptor.listen(kMaxClients, error);
  if (error)
    return unwritable("cannot listen on " + address_of(endpoint) + ": " + error.message() +
                      "; --igtl 0 takes any free port");
  return std::unique_ptr<IgtlServer>(
      std::make_unique<TcpServer>(std::move(acceptor), std::move(refused)));
}

}  // namespace trocar::runtime
