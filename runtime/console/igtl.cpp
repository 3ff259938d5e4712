// SPDX-License-Identifier: Apache-2.0
#include "runtime/console/igtl.h"

#include <igtlPolyDataMessage.h>
#include <igtlSensorMessage.h>
#include <igtlStatusMessage.h>
#include <igtlTransformMessage.h>
#include <igtlUnit.h>
#include <igtl_util.h>
#include <linux/sockios.h>
#include <sys/ioctl.h>
#include <algorithm>
#include <array>
#include <boost/asio.hpp>
#include <boost/asio/ip/address.hpp>
#include <boost/endian/conversion.hpp>
#include <charconv>
#include <cmath>
#include <sstream>
#include <utility>
#include <vector>

namespace trocar::runtime {

Result<IgtlAddress> parse_igtl_address(std::string_view text) {
  const Error wrong = usage("--igtl " + std::string(text) +
                            ": must be PORT or ADDRESS:PORT with a numerical address, for instance "
                            "18944 or 127.0.0.1:18944");
  IgtlAddress out;
  std::string_view port = text;
  if (const std::size_t colon = text.rfind(':'); colon != std::string_view::npos) {
    port = text.substr(colon + 1);
    std::string_view host = text.substr(0, colon);
    const bool has_brackets = host.size() > 2 && host.front() == '[' && host.back() == ']';
    if (has_brackets) host = host.substr(1, host.size() - 2);
    boost::system::error_code error;
    const boost::asio::ip::address address =
        boost::asio::ip::make_address(std::string(host), error);
    if (error || address.is_v6() != has_brackets) return wrong;
    out.address = address.to_string();
  }
  const auto [end, failed] = std::from_chars(port.data(), port.data() + port.size(), out.port);
  if (failed != std::errc{} || end != port.data() + port.size()) return wrong;
  return out;
}

namespace {

std::string packed(igtl::MessageBase& message, IgtlStamp stamp) {
  constexpr double kFractions = 4294967296.0;  // a second is 2^32 units of the time stamp
  const double whole_s = std::floor(stamp.unix_s);
  message.SetDeviceName(stamp.name);
  message.SetTimeStamp(static_cast<unsigned>(whole_s),
                       static_cast<unsigned>((stamp.unix_s - whole_s) * kFractions));
  message.Pack();
  return {static_cast<const char*>(message.GetPackPointer()),
          static_cast<std::size_t>(message.GetPackSize())};
}

}  // namespace

std::string transform_message(IgtlStamp stamp, const Eigen::Affine3d& T_mm) {
  const igtl::TransformMessage::Pointer message = igtl::TransformMessage::New();
  igtl::Matrix4x4 matrix;
  for (int i = 0; i < 4; ++i) {
    for (int j = 0; j < 4; ++j)
      matrix[i][j] = static_cast<float>(T_mm.matrix()(i, j));
  }
  message->SetMatrix(matrix);
  return packed(*message, stamp);
}

std::string sensor_message(IgtlStamp stamp, std::span<const double> values, IgtlUnit unit) {
  const igtl::SensorMessage::Pointer message = igtl::SensorMessage::New();
  const igtl::Unit::Pointer packed_unit = igtl::Unit::New();
  packed_unit->Append(
      unit == IgtlUnit::kNewton ? igtl::Unit::SI_DERIVED_NEWTON : igtl::Unit::SI_BASE_SECOND, 1);
  message->SetLength(static_cast<unsigned>(values.size()));
  message->SetUnit(packed_unit->Pack());
  for (std::size_t i = 0; i < values.size(); ++i)
    message->SetValue(static_cast<unsigned>(i), values[i]);
  return packed(*message, stamp);
}

std::string status_message(IgtlStamp stamp, IgtlStatus code, const std::string& error,
                           const std::string& text) {
  const igtl::StatusMessage::Pointer message = igtl::StatusMessage::New();
  message->SetCode(static_cast<int>(code));
  message->SetSubCode(0);  // the library does not initialise it
  message->SetErrorName(error.c_str());
  message->SetStatusString(text.c_str());
  return packed(*message, stamp);
}

std::string polydata_message(IgtlStamp stamp, std::span<const float> vertices_mm,
                             std::span<const std::uint32_t> triangles) {
  const igtl::PolyDataPointArray::Pointer points = igtl::PolyDataPointArray::New();
  points->SetNumberOfPoints(static_cast<int>(vertices_mm.size() / 3));
  for (std::size_t v = 0; v + 2 < vertices_mm.size(); v += 3)
    points->SetPoint(static_cast<unsigned>(v / 3), vertices_mm[v], vertices_mm[v + 1],
                     vertices_mm[v + 2]);
  const igtl::PolyDataCellArray::Pointer cells = igtl::PolyDataCellArray::New();
  for (std::size_t t = 0; t + 2 < triangles.size(); t += 3) {
    igtlUint32 cell[] = {triangles[t], triangles[t + 1], triangles[t + 2]};
    cells->AddCell(3, cell);
  }
  const igtl::PolyDataMessage::Pointer message = igtl::PolyDataMessage::New();
  message->SetPoints(points);
  message->SetPolygons(cells);
  return packed(*message, stamp);
}

namespace {

// The header: version (2 bytes), type (12), name of the device (20), time (8), bytes of the body (8),
// checksum (8); numbers are big-endian.
constexpr std::size_t kTypeAt = 2, kDeviceAt = 14, kTimeAt = 34, kBodyAt = 42, kCrcAt = 50;
constexpr std::uint16_t kLastVersion = 3;

/// The printable text before the first zero; none: it has other characters.
std::optional<std::string> text(std::span<const std::uint8_t> bytes) {
  const auto end = std::find(bytes.begin(), bytes.end(), 0);
  if (!std::all_of(bytes.begin(), end, [](std::uint8_t c) { return c >= ' ' && c <= '~'; }))
    return std::nullopt;
  return std::string(bytes.begin(), end);
}

}  // namespace

std::optional<IgtlHeader> read_igtl_header(std::span<const std::uint8_t, kIgtlHeaderBytes> bytes) {
  const std::uint16_t version = boost::endian::load_big_u16(bytes.data());
  const auto type = text(bytes.subspan(kTypeAt, kDeviceAt - kTypeAt));
  const auto device = text(bytes.subspan(kDeviceAt, kTimeAt - kDeviceAt));
  const std::uint64_t body_bytes = boost::endian::load_big_u64(&bytes[kBodyAt]);
  if (version < 1 || version > kLastVersion || !type || type->empty() || !device ||
      body_bytes > kMaxIgtlBody)
    return std::nullopt;
  return IgtlHeader{*type, static_cast<std::size_t>(body_bytes),
                    boost::endian::load_big_u64(&bytes[kCrcAt])};
}

bool is_igtl_body(const IgtlHeader& header, std::span<const std::uint8_t> body) {
  std::vector<std::uint8_t> bytes(body.begin(), body.end());  // the library takes no constant bytes
  return crc64(bytes.data(), bytes.size(), 0) == header.crc;
}

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
