// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <chrono>
#include <functional>

#include "formats/base/result.h"

namespace trocar::pipeline {

/// Measures the times of consecutive steps (laps).
class Stopwatch {
 public:
  using TimePoint = std::chrono::steady_clock::time_point;

  explicit Stopwatch(TimePoint start = std::chrono::steady_clock::now()) : start_(start) {}

  /// The time in ms since the last call of lap_ms(); at the first call, since `start`.
  double lap_ms() {
    const TimePoint now = std::chrono::steady_clock::now();
    const double ms = std::chrono::duration<double, std::milli>(now - start_).count();
    start_ = now;
    return ms;
  }

 private:
  TimePoint start_;
};

// A setting of malloc that makes meshing faster.

/// Tells glibc's malloc to reuse freed memory instead of returning large blocks to the system. The
/// system would clear the memory before giving it out again. Without this clearing, the time to
/// mesh a slice is up to a quarter shorter. Call the function first in main(), before there are
/// other threads. With other C libraries the function has no effect.
void keep_freed_memory();

// A parallel loop on the threads of the library TBB.

/// Calls each of task(0), ..., task(count - 1) once, several at the same time and in no fixed
/// order. Returns when all have ended. What the caller wrote before the call is visible in every
/// task, and what the tasks wrote is visible after the call.
void parallel_for(int count, const std::function<void(int)>& task);

/// The same for tasks that can fail. Returns the error of the lowest index.
Result<void> try_in_parallel(int count, const std::function<Result<void>(int)>& task);

}  // namespace trocar::pipeline
