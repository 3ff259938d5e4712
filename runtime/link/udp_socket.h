// SPDX-License-Identifier: Apache-2.0
// A non-blocking IPv4 datagram socket (UDP), and its addresses. After a socket has been made, each
// of its functions makes at most one system call, and none allocates or throws. Only wait() blocks.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>

#include "formats/base/file_descriptor.h"
#include "formats/base/result.h"

namespace trocar::runtime {

struct Endpoint {
  std::uint32_t address = 0;  ///< in the machine's byte order; 0x7f000001 is 127.0.0.1
  std::uint16_t port = 0;
  bool is_loopback() const noexcept { return address >> 24 == 127; }
  friend bool operator==(const Endpoint&, const Endpoint&) = default;
};
std::string to_string(const Endpoint& endpoint);

/// Parses HOST:PORT. HOST is a dotted IPv4 address, or a name whose IPv4 address is looked up.
/// Errors: kUsage if `text` has another form, the name is unknown, or the port is below
/// `lowest_port`; the message quotes `text`. If `lowest_port` is 0, port 0 is allowed: the system
/// then chooses a port to listen on.
Result<Endpoint> parse_endpoint(std::string_view text, int lowest_port);

class UdpSocket {
 public:
  /// Opens a socket bound to `local`. Errors: kUnwritable if the address is not available.
  static Result<UdpSocket> listen(const Endpoint& local);
  /// Opens a socket that sends to `peer` and receives from `peer` only. Errors: kDeviceFault if the
  /// system refuses the socket.
  static Result<UdpSocket> connect(const Endpoint& peer);

  enum class Outcome : std::uint8_t {
    kDone,
    kNothing,  ///< no datagram is waiting, or the send buffer is full
    kGone,     ///< the other end is closed, or the socket failed
  };
  /// Receives one datagram into `buffer`. On kDone, `bytes` is the datagram's full length, even if
  /// the buffer is shorter, and `from` is the sender.
  Outcome receive(std::span<std::uint8_t> buffer, std::size_t& bytes, Endpoint& from) noexcept;
  /// Sends a datagram to the peer of connect().
  Outcome send(std::span<const std::uint8_t> datagram) noexcept;
  Outcome send_to(std::span<const std::uint8_t> datagram, const Endpoint& to) noexcept;
  /// Waits at most `seconds` for a datagram. Returns false if none has arrived, or if a signal
  /// has interrupted the wait.
  bool wait(double seconds) noexcept;
  /// Returns the address and port to which the socket is bound.
  Endpoint local() const noexcept;
  /// errno of the last operation that returned Outcome::kGone; 0 if none did.
  int error() const noexcept { return error_; }

 private:
  explicit UdpSocket(int fd) : fd_(fd) {}
  Outcome outcome_of(std::int64_t done) noexcept;
  FileDescriptor fd_;
  int error_ = 0;
};

}  // namespace trocar::runtime
