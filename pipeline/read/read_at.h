// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <unistd.h>

#include <cerrno>
#include <cstdint>
#include <span>

namespace trocar::pipeline {

/// Reads to.size() bytes from offset `at` of a file. Returns the number of bytes read, which is
/// smaller than to.size() at the end of the file and after an error.
inline std::size_t read_at(int descriptor, std::int64_t at, std::span<char> to) {
  std::size_t done = 0;
  while (done < to.size()) {
    const ssize_t n = ::pread(descriptor, to.data() + done, to.size() - done,
                              at + static_cast<std::int64_t>(done));
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) break;
    done += static_cast<std::size_t>(n);
  }
  return done;
}

}  // namespace trocar::pipeline
