// SPDX-License-Identifier: GPL-3.0-or-later
// A TCP socket that listens at one address of the computer only. DCMTK 3.6.7 cannot do this: it
// listens at all addresses of the computer.
#pragma once

#include <string>

#include "formats/base/file_descriptor.h"
#include "formats/base/result.h"

namespace trocar::archive {

class ListeningSocket {
 public:
  /// If `port` is 0, the system chooses a free port. Errors: kUsage if the address is not numeric;
  /// kRefused if the address or the port cannot be used.
  static Result<ListeningSocket> open(const std::string& address, int port);
  int fd() const { return fd_.get(); }
  int port() const { return port_; }
  /// Accepts the next connection and returns its descriptor, or -1 if no connection waits. Does not
  /// block.
  int accept() const;

 private:
  ListeningSocket(int fd, int port) : fd_(fd), port_(port) {}
  FileDescriptor fd_;
  int port_;
};

}  // namespace trocar::archive
