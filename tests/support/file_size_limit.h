// SPDX-License-Identifier: Apache-2.0
// Limits the size of the files that this process writes, in place of a full disk: a write stores the
// bytes that fit, and the next one fails.
#pragma once

#include <sys/resource.h>

#include <csignal>
#include <cstddef>

namespace trocar::test {

class FileSizeLimit {
 public:
  explicit FileSizeLimit(std::size_t bytes) {
    before_signal_ = std::signal(SIGXFSZ, SIG_IGN);
    ::getrlimit(RLIMIT_FSIZE, &before_);
    const rlimit now{bytes, before_.rlim_max};
    ::setrlimit(RLIMIT_FSIZE, &now);
  }
  ~FileSizeLimit() {
    ::setrlimit(RLIMIT_FSIZE, &before_);
    std::signal(SIGXFSZ, before_signal_);
  }
  FileSizeLimit(const FileSizeLimit&) = delete;
  FileSizeLimit& operator=(const FileSizeLimit&) = delete;

 private:
  rlimit before_{};
  void (*before_signal_)(int) = nullptr;
};

}  // namespace trocar::test
