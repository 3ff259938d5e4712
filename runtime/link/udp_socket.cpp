// SPDX-License-Identifier: Apache-2.0
#include "runtime/link/udp_socket.h"

#include <netdb.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <system_error>

#include "formats/base/system_message.h"

namespace trocar::runtime {
namespace {

sockaddr_in to_system(const Endpoint& endpoint) noexcept {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(endpoint.port);
  address.sin_addr.s_addr = htonl(endpoint.address);
  return address;
}

Endpoint from_system(const sockaddr_in& address) noexcept {
  return {ntohl(address.sin_addr.s_addr), ntohs(address.sin_port)};
}

int make_socket() noexcept {
  return ::socket(AF_INET, SOCK_DGRAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
}

}  // namespace

std::string to_string(const Endpoint& endpoint) {
  std::string text;
  for (int shift = 24; shift >= 0; shift -= 8) {
    text += std::to_string((endpoint.address >> shift) & 0xff) + (shift > 0 ? "." : ":");
  }
  return text + std::to_string(endpoint.port);
}

Result<Endpoint> parse_endpoint(std::string_view text, int lowest_port) {
  const std::size_t colon = text.rfind(':');
  std::string quoted = "\"";
  quoted.append(text.substr(0, 256)).append("\"");
  if (colon == std::string_view::npos || colon == 0) {
    return usage(quoted + ": must be HOST:PORT, for instance 127.0.0.1:4840");
  }
  const std::string_view digits = text.substr(colon + 1);
  int port = -1;
  const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), port);
  if (error != std::errc{} || end != digits.data() + digits.size() || port < lowest_port ||
      port > 65535) {
    return usage(quoted + ": the port must be within " + std::to_string(lowest_port) +
                 " and 65535");
  }
  addrinfo hints{};
  hints.ai_family = AF_INET;
  hints.ai_socktype = SOCK_DGRAM;
  addrinfo* found = nullptr;
  // This name means this computer (RFC 6761), also where no /etc/hosts says so.
  const std::string name(text.substr(0, colon)), host = name == "localhost" ? "127.0.0.1" : name;
  if (const int failed = ::getaddrinfo(host.c_str(), nullptr, &hints, &found); failed != 0) {
    return usage(quoted + ": the name \"" + host.substr(0, 256) + "\" gives no address (" +
                 ::gai_strerror(failed) + "); check it, or give the address in digits");
  }
  Endpoint endpoint = from_system(*reinterpret_cast<const sockaddr_in*>(found->ai_addr));
  ::freeaddrinfo(found);
  endpoint.port = static_cast<std::uint16_t>(port);
  return endpoint;
}

Result<UdpSocket> UdpSocket::listen(const Endpoint& local) {
  UdpSocket made(make_socket());
  const sockaddr_in address = to_system(local);
  if (made.fd_.get() < 0 ||
      ::bind(made.fd_.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0) {
    return unwritable(to_string(local) + ": cannot listen: " + system_message(errno));
  }
  return made;
}

Result<UdpSocket> UdpSocket::connect(const Endpoint& peer) {
  UdpSocket made(make_socket());
  const sockaddr_in address = to_system(peer);
  if (made.fd_.get() < 0 ||
      ::connect(made.fd_.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0) {
    return Error{ExitCode::kDeviceFault, to_string(peer) + ": " + system_message(errno)};
  }
  return made;
}

UdpSocket::Outcome UdpSocket::outcome_of(std::int64_t done) noexcept {
  if (done >= 0) return Outcome::kDone;
  switch (errno) {
    case EAGAIN:
    case EINTR:
    case ENOBUFS:
      return Outcome::kNothing;
    default:
      error_ = errno;
      return Outcome::kGone;
  }
}

UdpSocket::Outcome UdpSocket::receive(std::span<std::uint8_t> buffer, std::size_t& bytes,
                                      Endpoint& from) noexcept {
  sockaddr_in address{};
  socklen_t length = sizeof address;
  const ssize_t got = ::recvfrom(fd_.get(), buffer.data(), buffer.size(), MSG_TRUNC,
                                 reinterpret_cast<sockaddr*>(&address), &length);
  if (got >= 0) {
    bytes = static_cast<std::size_t>(got);
    from = from_system(address);
  }
  return outcome_of(got);
}

UdpSocket::Outcome UdpSocket::send(std::span<const std::uint8_t> datagram) noexcept {
  return outcome_of(::send(fd_.get(), datagram.data(), datagram.size(), MSG_NOSIGNAL));
}

UdpSocket::Outcome UdpSocket::send_to(std::span<const std::uint8_t> datagram,
                                      const Endpoint& to) noexcept {
  const sockaddr_in address = to_system(to);
  return outcome_of(::sendto(fd_.get(), datagram.data(), datagram.size(), MSG_NOSIGNAL,
                             reinterpret_cast<const sockaddr*>(&address), sizeof address));
}

bool UdpSocket::wait(double seconds) noexcept {
  pollfd waited{fd_.get(), POLLIN, 0};
  const double ms = std::ceil(std::clamp(seconds, 0.0, 3600.0) * 1e3);
  return ::poll(&waited, 1, static_cast<int>(ms)) > 0;
}

Endpoint UdpSocket::local() const noexcept {
  sockaddr_in address{};
  socklen_t length = sizeof address;
  ::getsockname(fd_.get(), reinterpret_cast<sockaddr*>(&address), &length);
  return from_system(address);
}

}  // namespace trocar::runtime
