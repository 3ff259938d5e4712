// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/archive/listening_socket.h"

#include <netdb.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include <cerrno>
#include <system_error>

namespace trocar::archive {
namespace {

constexpr int kQueue = 512;  // connections that wait; the system may allow fewer

}  // namespace

Result<ListeningSocket> ListeningSocket::open(const std::string& address, int port) {
  addrinfo hints{};
  hints.ai_socktype = SOCK_STREAM;
  hints.ai_flags = AI_NUMERICHOST | AI_NUMERICSERV | AI_PASSIVE;
  addrinfo* found = nullptr;
  const std::string number = std::to_string(port);
  if (::getaddrinfo(address.c_str(), number.c_str(), &hints, &found) != 0)
    return usage("--listen " + address + ": must be a numeric address, as in 192.168.1.5");
  const int fd = ::socket(found->ai_family, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  ListeningSocket out(fd, port);
  const int on = 1;
  const bool is_open = fd >= 0 && ::setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on) == 0 &&
                       ::bind(fd, found->ai_addr, found->ai_addrlen) == 0 &&
                       ::listen(fd, kQueue) == 0;
  const int error = errno;
  ::freeaddrinfo(found);
  if (!is_open)
    return refused(address + ":" + number + ": " + std::generic_category().message(error));
  sockaddr_storage bound{};
  socklen_t size = sizeof bound;
  if (::getsockname(fd, reinterpret_cast<sockaddr*>(&bound), &size) == 0)
    out.port_ =
        ntohs(bound.ss_family == AF_INET6 ? reinterpret_cast<const sockaddr_in6&>(bound).sin6_port
                                          : reinterpret_cast<const sockaddr_in&>(bound).sin_port);
  return out;
}

int ListeningSocket::accept() const {
  return ::accept4(fd_.get(), nullptr, nullptr, SOCK_CLOEXEC);
}

}  // namespace trocar::archive
