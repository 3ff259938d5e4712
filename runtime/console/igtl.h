// SPDX-License-Identifier: Apache-2.0
// The address at which the console serves OpenIGTLink clients.
#pragma once

#include <Eigen/Geometry>
#include <boost/asio/io_context.hpp>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "formats/base/result.h"

namespace trocar::runtime {

struct IgtlAddress {
  std::string address = "127.0.0.1";  ///< numerical IPv4 or IPv6 address
  std::uint16_t port = 0;             ///< 0: any free port
};
/// Reads an address of the form [ADDRESS:]PORT, in which an IPv6 address has brackets. Without
/// ADDRESS, the address is 127.0.0.1. Errors: kUsage if the text has another form.
Result<IgtlAddress> parse_igtl_address(std::string_view text);

// Packs OpenIGTLink messages. Their headers have the protocol's version 1, which every client can
// read. Lengths are in mm, as the protocol requires. Each function returns a whole message.

/// The codes of STATUS messages that the console sends. OpenIGTLink defines more codes.
enum class IgtlStatus : std::uint8_t {
  kOk = 1,
  kUnknownError = 2,
  kEmergency = 3,
  kTimeOut = 7,
  kNotReady = 13,
  kNotPresent = 16,
  kShutDown = 19,
};
enum class IgtlUnit : std::uint8_t { kSecond, kNewton };

/// Name and time of a message. A name has at most 19 characters.
struct IgtlStamp {
  const char* name;
  double unix_s;  ///< UTC, since 1970
};

/// Packs a TRANSFORM: the pose of an object, as a transform with the translation in mm.
std::string transform_message(IgtlStamp stamp, const Eigen::Affine3d& T_mm);
/// Packs a SENSOR message: at most 255 values of one unit.
std::string sensor_message(IgtlStamp stamp, std::span<const double> values, IgtlUnit unit);
/// Packs a STATUS message: a code, the name of an error, and a text. `error` has at most 19
/// characters, and is empty if there is no error.
std::string status_message(IgtlStamp stamp, IgtlStatus code, const std::string& error,
                           const std::string& text);
/// Packs a POLYDATA message: x, y, z of each vertex in mm, and three vertex
/// indices for each triangle.
std::string polydata_message(IgtlStamp stamp, std::span<const float> vertices_mm,
                             std::span<const std::uint32_t> triangles);

// Reads the messages of OpenIGTLink clients, which are not trusted.

inline constexpr std::size_t kIgtlHeaderBytes = 58;
inline constexpr std::size_t kMaxIgtlBody = std::size_t{64} << 10;

struct IgtlHeader {
  std::string type;
  std::size_t body_bytes = 0;  ///< at most kMaxIgtlBody
  std::uint64_t crc = 0;       ///< checksum of the body
};

/// Reads a header. Returns nullopt if the header is malformed, has an unknown version, or announces
/// a body of more than kMaxIgtlBody bytes.
std::optional<IgtlHeader> read_igtl_header(std::span<const std::uint8_t, kIgtlHeaderBytes> bytes);

/// Returns true if the body has the checksum that the header states.
bool is_igtl_body(const IgtlHeader& header, std::span<const std::uint8_t> body);

// Sends data of one session to OpenIGTLink clients: the tool's pose, the force, the session's state
// and the bone's surface. Nothing is queued for a client: when the previous messages to the client
// have been sent, the next messages are chosen from the present state.

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

class IgtlServer {
 public:
  using Clock = std::chrono::steady_clock;
  /// A function that is called when a client is refused. `kind`: the reason. `from`:
  /// the client's address.
  using Refused = std::function<void(const char* kind, const std::string& from)>;

  /// Makes a server that listens on `address`. Errors: kUnwritable if it cannot
  /// listen on `address`.
  static Result<std::unique_ptr<IgtlServer>> listen(boost::asio::io_context& context,
                                                    const IgtlAddress& address, Refused refused);
  virtual ~IgtlServer() = default;
  IgtlServer(const IgtlServer&) = delete;
  IgtlServer& operator=(const IgtlServer&) = delete;

  /// ADDRESS:PORT on which the server listens.
  virtual std::string endpoint() const = 0;
  virtual bool has_clients() const = 0;
  /// Sends the changed parts of the state to each client whose previous messages have been sent. A
  /// client gets IgtlState::tick at most 60 times in a second. If a client leaves sent data unread
  /// for 6 s, it is disconnected. Call this every few milliseconds.
  virtual void pump(const IgtlState& state, Clock::time_point now) = 0;

 protected:
  IgtlServer() = default;
};

}  // namespace trocar::runtime
