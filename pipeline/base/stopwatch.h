// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <chrono>

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

}  // namespace trocar::pipeline
