// SPDX-License-Identifier: Apache-2.0
// Reads the system's monotonic clock in nanoseconds.
#pragma once

#include <cstdint>
#include <ctime>

namespace trocar::runtime {

/// Returns the time of CLOCK_MONOTONIC in ns. On most Linux kernels this needs no system call.
inline std::int64_t monotonic_ns() noexcept {
  timespec now{};
  ::clock_gettime(CLOCK_MONOTONIC, &now);
  return now.tv_sec * std::int64_t{1'000'000'000} + now.tv_nsec;
}

}  // namespace trocar::runtime
