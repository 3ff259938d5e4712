// SPDX-License-Identifier: Apache-2.0
// A non-blocking IPv4 datagram socket and where it leads. After it is made, nothing allocates,
// blocks or throws: each call is one system call.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>

#include "formats/base/result.h"

namespace trocar::runtime {

struct Endpoint {
  std::uint32_t address = 0;  ///< in the machine's byte order; 0x7f000001 is 127.0.0.1
  std::uint16_t port = 0;
  bool is_loopback() const noexcept { return address >> 24 == 127; }
  friend bool operator==(const Endpoint&, const Endpoint&) = default;
};
std::string to_string(const Endpoint& endpoint);

/// HOST:PORT; HOST a dotted address, or a name, which is looked up (IPv4). Usage errors say what is
/// wrong with `text`. `lowest_port` 0 lets the system choose where one listens.
Result<Endpoint> parse_endpoint(std::string_view text, int lowest_port);

class UdpSocket {
 public:
  /// Bound to `local`. Errors: unwritable, when the address cannot be had.
  static Result<UdpSocket> listen(const Endpoint& local);
  /// Sends to `peer` and hears from nobody else.
  static Result<UdpSocket> connect(const Endpoint& peer);
  UdpSocket(UdpSocket&& other) noexcept;
  UdpSocket& operator=(UdpSocket&&) = delete;
  ~UdpSocket();

  enum class Outcome : std::uint8_t {
    kDone,
    kNothing,  ///< nothing is there to be received, or no room to send now
    kGone,     ///< nobody listens at the other end, or the socket failed
  };
  /// One datagram into `buffer`; `bytes` is its whole length, also where the buffer is shorter.
  Outcome receive(std::span<std::uint8_t> buffer, std::size_t& bytes, Endpoint& from) noexcept;
  Outcome send(std::span<const std::uint8_t> datagram) noexcept;  ///< connected
  Outcome send_to(std::span<const std::uint8_t> datagram, const Endpoint& to) noexcept;
  /// Waits until something can be received, at most `seconds`. Blocks.
  bool wait(double seconds) noexcept;
  Endpoint local() const noexcept;

 private:
  explicit UdpSocket(int fd) : fd_(fd) {}
  int fd_ = -1;
};

}  // namespace trocar::runtime
