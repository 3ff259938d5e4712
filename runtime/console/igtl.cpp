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
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <boost/asio.hpp>
#include <boost/asio/ip/address.hpp>
#include <boost/endian/conversion.hpp>
#include <charconv>
#include <cmath>
#include <exception>
#include <span>
#include <sstream>
#include <vector>

#include "formats/session/recording.h"
#include "runtime/console/answers.h"
#include "runtime/console/server.h"
#include "runtime/device/device.h"

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

// Packs OpenIGTLink messages. Their headers have the protocol's version 1, which every client can
// read. Lengths are in mm, as the protocol requires. Each function returns a whole message.

/// Name and time of a message. A name has at most 19 characters.
struct IgtlStamp {
  const char* name;
  double unix_s;  ///< UTC, since 1970
};

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

/// Packs a TRANSFORM: the pose of an object, as a transform with the translation in mm.
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

/// Packs a SENSOR message: at most 255 values of one unit.
std::string sensor_message(IgtlStamp stamp, std::span<const double> values, int unit) {
  const igtl::SensorMessage::Pointer message = igtl::SensorMessage::New();
  const igtl::Unit::Pointer packed_unit = igtl::Unit::New();
  packed_unit->Append(unit, 1);
  message->SetLength(static_cast<unsigned>(values.size()));
  message->SetUnit(packed_unit->Pack());
  for (std::size_t i = 0; i < values.size(); ++i)
    message->SetValue(static_cast<unsigned>(i), values[i]);
  return packed(*message, stamp);
}

/// Packs a STATUS message: a code, the name of an error, and a text. `error` has at most 19
/// characters, and is empty if there is no error.
std::string status_message(IgtlStamp stamp, int code, const std::string& error,
                           const std::string& text) {
  const igtl::StatusMessage::Pointer message = igtl::StatusMessage::New();
  message->SetCode(code);
  message->SetSubCode(0);  // the library does not initialise it
  message->SetErrorName(error.c_str());
  message->SetStatusString(text.c_str());
  return packed(*message, stamp);
}

/// Packs a POLYDATA message: x, y, z of each vertex in mm, and three vertex
/// indices for each triangle.
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

// Reads the messages of clients, which are not trusted.

constexpr std::size_t kIgtlHeaderBytes = 58;
constexpr std::size_t kMaxIgtlBody = std::size_t{64} << 10;

struct IgtlHeader {
  std::string type;
  std::size_t body_bytes = 0;  ///< at most kMaxIgtlBody
  std::uint64_t crc = 0;       ///< checksum of the body
};

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

/// Reads a header. Returns nullopt if the header is malformed, has an unknown version, or announces
/// a body of more than kMaxIgtlBody bytes.
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

/// Returns true if the body has the checksum that the header states.
bool is_igtl_body(const IgtlHeader& header, std::span<const std::uint8_t> body) {
  std::vector<std::uint8_t> bytes(body.begin(), body.end());  // the library takes no constant bytes
  return crc64(bytes.data(), bytes.size(), 0) == header.crc;
}

/// Packed messages, shared by all clients.
using IgtlBytes = std::shared_ptr<const std::string>;

/// The present state of a session as messages: status, latest tick, and surface. A client gets the
/// status when `status_number` has changed, the tick when `tick_number` has changed, and the
/// surface once. When `session` changes, the client gets all three again. On request, a client also
/// gets the status or the surface again.
struct IgtlState {
  std::uint64_t session = 0;
  std::uint64_t status_number = 0;
  IgtlBytes status;
  std::uint64_t tick_number = 0;
  IgtlBytes tick;     ///< pose, force and time of one tick; null: no tick yet
  IgtlBytes surface;  ///< null: there is no surface, or it is not loaded yet
};

namespace net = boost::asio;
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
std::string address_of(const net::ip::tcp::endpoint& endpoint) {
  return (std::ostringstream() << endpoint).str();
}

/// One client.
class Client : public std::enable_shared_from_this<Client> {
 public:
  Client(net::ip::tcp::socket socket, std::string from, RefusalLog& log)
      : socket_(std::move(socket)), from_(std::move(from)), log_(log) {}

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
    if (waiting() <= kMaxWaiting)
      progress_at_ = now;
    else if (now - progress_at_ > kIgtlStalled)
      return close();
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
    log_.refused(kind, from_);
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

  net::ip::tcp::socket socket_;
  std::string from_;
  RefusalLog& log_;
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

constexpr const char *kTime = "TrocarTime", *kState = "TrocarState", *kBone = "TrocarBone";
// Bytes that a surface takes in its message at most; viewers have no use for a larger one.
constexpr std::size_t kMaxSurfaceBytes = std::size_t{256} << 20;

template <typename AnyClock>
double seconds_of(const std::chrono::time_point<AnyClock>& time) {
  return std::chrono::duration<double>(time.time_since_epoch()).count();
}
double unix_s() {
  return seconds_of(std::chrono::system_clock::now());
}

IgtlBytes shared(std::string bytes) {
  return std::make_shared<const std::string>(std::move(bytes));
}

int code_of(RunState state, Fault fault) {
  switch (state) {
    case RunState::kIdle:
    case RunState::kLost:
      return igtl::StatusMessage::STATUS_NOT_PRESENT;
    case RunState::kStarting:
      return igtl::StatusMessage::STATUS_NOT_READY;
    case RunState::kSilent:
      return igtl::StatusMessage::STATUS_TIME_OUT;
    case RunState::kEnded:
      return igtl::StatusMessage::STATUS_SHUT_DOWN;
    case RunState::kRunning:
    case RunState::kPaused:
      break;
  }
  if (fault == Fault::kNone) return igtl::StatusMessage::STATUS_OK;
  return fault == Fault::kEmergencyStop ? igtl::StatusMessage::STATUS_PANICK_MODE
                                        : igtl::StatusMessage::STATUS_UNKNOWN_ERROR;
}

Eigen::Vector3d vector(const SessionTelemetry& telemetry, const char* column) {
  return {telemetry.value(column, 0), telemetry.value(column, 1), telemetry.value(column, 2)};
}

/// The tool's pose in {B}, in mm: the origin at its tip, z up its shaft, x and y as those of the plate,
/// tilted with the tool.
Eigen::Affine3d tool_pose(const SessionTelemetry& telemetry) {
  const Eigen::Quaterniond q(telemetry.value("q", 0), telemetry.value("q", 1),
                             telemetry.value("q", 2), telemetry.value("q", 3));
  const Eigen::Vector3d shaft_plate = q.conjugate() * -vector(telemetry, "axis");
  Eigen::Affine3d T = Eigen::Affine3d::Identity();
  T.linear() = (q * rotation_from_z(shaft_plate)).toRotationMatrix();
  T.translation() = vector(telemetry, "tool_m") * 1e3;
  return T;
}

class TcpServer : public IgtlServer {
 public:
  TcpServer(ConsoleState& console, net::ip::tcp::acceptor acceptor)
      : console_(console), acceptor_(std::move(acceptor)), retry_(acceptor_.get_executor()) {
    accept();
  }

  std::string endpoint() const override {
    ErrorCode ignored;
    return address_of(acceptor_.local_endpoint(ignored));
  }
  void poll(Clock::time_point now) override {
    const SessionTelemetry& telemetry = console_.supervisor.telemetry();
    const double offset_s = unix_s() - seconds_of(Clock::now());
    if (state_.session != telemetry.sessions()) {
      state_ = {telemetry.sessions(), state_.status_number, nullptr, 0, nullptr, nullptr};
      position_.reset();
      asked_.reset();
      shown_ticks_ = 0;
    }
    update_status(seconds_of(now) + offset_s);
    if (!clients_.empty()) {
      if (!asked_ && telemetry.snapshot()) load_position();
      // Before the device has been read, its pose means nothing. A snapshot may show the same tick as the
      // one before, as in a pause.
      if (position_ && telemetry.value("ticks") != shown_ticks_ && telemetry.value("safety") != 0)
        update_tick(telemetry.value("taken_at_s") + offset_s);
    }
    for (const auto& client : clients_)
      client->pump(state_, now);
    remove_closed();
  }

 private:
  /// T_patient_device: the member of PatientBone. surface: the message with the bone's surface;
  /// null: no surface.
  struct Position {
    std::optional<Eigen::Affine3d> T_patient_device;
    IgtlBytes surface;
  };

  void load_position() {
    asked_ = state_.session;
    const auto scene = console_.supervisor.scene_file(), asset = console_.supervisor.asset_file();
    boost::asio::post(console_.worker, [this, scene, asset, session = state_.session] {
      Position made;
      try {
        const Result<PatientBone> bone = patient_bone_of(scene, asset);
        if (bone) made.T_patient_device = bone->T_patient_device;
        if (bone && !bone->triangles.empty() &&
            bone->triangles.size() * 6 + bone->vertices_mm.size() * 4 <= kMaxSurfaceBytes)
          made.surface =
              shared(polydata_message({kBone, unix_s()}, bone->vertices_mm, bone->triangles));
      } catch (const std::exception&) {  // a hostile file must not end the console
        made = {};
      }
      boost::asio::post(console_.context, [this, made = std::move(made), session] {
        if (session != state_.session) return;
        state_.surface = made.surface;
        position_ = made;
      });
    });
  }

  void update_status(double now_unix_s) {
    const SessionTelemetry& telemetry = console_.supervisor.telemetry();
    const RunState state = console_.supervisor.state();
    const double number = telemetry.value("fault");
    const int fault = number >= 0 && number < kFaults ? static_cast<int>(number) : 0;
    if (state_.status && shown_status_ == std::pair(state, fault)) return;
    shown_status_ = {state, fault};
    const auto what = static_cast<Fault>(fault);
    ++state_.status_number;
    state_.status =
        shared(status_message({kState, now_unix_s}, code_of(state, what),
                              what == Fault::kNone ? "" : to_string(what), to_string(state)));
  }

  void update_tick(double taken_unix_s) {
    const SessionTelemetry& telemetry = console_.supervisor.telemetry();
    shown_ticks_ = telemetry.value("ticks");
    ++state_.tick_number;
    Eigen::Affine3d T_tool = tool_pose(telemetry);
    Eigen::Vector3d force_N = vector(telemetry, "wrench_delivered");
    const std::optional<Eigen::Affine3d>& T_patient_device = position_->T_patient_device;
    if (T_patient_device) {
      T_tool = *T_patient_device * T_tool;
      force_N = T_patient_device->linear() * force_N;
    }
    // A name says in which frame its values are: that of the patient, or that of the device.
    const char* const tool_name = T_patient_device ? "TrocarTool" : "TrocarToolInB";
    const char* const force_name = T_patient_device ? "TrocarForce" : "TrocarForceInB";
    const double t_s = telemetry.value("t_s");
    state_.tick =
        shared(transform_message({tool_name, taken_unix_s}, T_tool) +
               sensor_message({force_name, taken_unix_s}, {force_N.data(), 3},
                              igtl::Unit::SI_DERIVED_NEWTON) +
               sensor_message({kTime, taken_unix_s}, {&t_s, 1}, igtl::Unit::SI_BASE_SECOND));
  }

  void accept() {
    acceptor_.async_accept([this](ErrorCode error, net::ip::tcp::socket socket) {
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

  void open(net::ip::tcp::socket socket) {
    ErrorCode error;
    const net::ip::tcp::endpoint peer = socket.remote_endpoint(error);
    if (error) return;
    remove_closed();
    if (clients_.size() >= kMaxClients)
      return console_.log.refused("an OpenIGTLink client beyond 8", address_of(peer));
    socket.set_option(net::ip::tcp::no_delay(true), error);
    socket.set_option(net::socket_base::send_buffer_size(kIgtlSendBuffer), error);
    clients_.push_back(std::make_shared<Client>(std::move(socket), address_of(peer), console_.log));
    clients_.back()->read_header();
  }

  void remove_closed() {
    std::erase_if(clients_, [](const auto& client) { return client->is_closed(); });
  }

  ConsoleState& console_;
  net::ip::tcp::acceptor acceptor_;
  net::steady_timer retry_;
  std::vector<std::shared_ptr<Client>> clients_;
  IgtlState state_;
  std::optional<std::uint64_t> asked_;  ///< number of the session for which loading has begun
  std::optional<Position> position_;    ///< nullopt: not loaded yet
  double shown_ticks_ = 0;              ///< number of ticks done when the last sent pose was taken
  std::pair<RunState, int> shown_status_{RunState::kIdle, -1};  ///< state and fault sent last
};

}  // namespace

Result<std::unique_ptr<IgtlServer>> IgtlServer::listen(ConsoleState& console,
                                                       const IgtlAddress& address) {
  ErrorCode error;
  const net::ip::tcp::endpoint endpoint(net::ip::make_address(address.address, error),
                                        address.port);
  net::ip::tcp::acceptor acceptor(console.context);
  if (!error) acceptor.open(endpoint.protocol(), error);
  if (!error) acceptor.set_option(net::socket_base::reuse_address(true), error);
  if (!error) acceptor.bind(endpoint, error);
  if (!error) acceptor.listen(kMaxClients, error);
  if (error)
    return unwritable("cannot listen on " + address_of(endpoint) + ": " + error.message() +
                      "; --igtl 0 takes any free port");
  return std::unique_ptr<IgtlServer>(std::make_unique<TcpServer>(console, std::move(acceptor)));
}

}  // namespace trocar::runtime
