// SPDX-License-Identifier: Apache-2.0
// Owner of a file descriptor. Its destructor closes the descriptor.
#pragma once

#include <unistd.h>

#include <utility>

namespace trocar {

class FileDescriptor {
 public:
  /// Owns `fd`. A negative `fd` is allowed, because it is the result of an open() that failed.
  explicit FileDescriptor(int fd) : fd_(fd) {}
  FileDescriptor(FileDescriptor&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
  FileDescriptor& operator=(FileDescriptor&&) = delete;
  ~FileDescriptor() {
    if (fd_ >= 0) ::close(fd_);
  }
  int get() const { return fd_; }
  /// Closes the descriptor now. Returns false and sets errno if data that was written may be lost.
  bool close() { return ::close(std::exchange(fd_, -1)) == 0; }

 private:
  int fd_;
};

}  // namespace trocar
