// SPDX-License-Identifier: GPL-3.0-or-later
// The time that each stage of a run took: the report's stages_ms.
// Tests: tests/e2e/stages_test.py
#pragma once

#include <algorithm>
#include <map>
#include <string>

#include "pipeline/base/stopwatch.h"

namespace trocar::pipeline {

class RunStages {
 public:
  explicit RunStages(Stopwatch::TimePoint start) : watch_(start) {}

  /// Adds the time since the last lap to the stage.
  void lap(const char* stage) { ms_[stage] += watch_.lap_ms(); }

  /// Adds the times of stages on which several threads have worked since the last lap. `thread_ms`
  /// has the time of each stage, summed over all threads; this sum is divided by the number of
  /// threads. `busy_ms` is the time in which threads were busy, summed over all threads. The rest
  /// of the time since the last lap is added to the stage `idle`. Busy time that belongs to no
  /// stage is not listed, so the stages can add up to less than the time of the run.
  void lap_shared(int threads, double busy_ms, const std::map<std::string, double>& thread_ms) {
    for (const auto& [stage, ms] : thread_ms)
      ms_[stage] += ms / threads;
    ms_["idle"] += std::max(0.0, watch_.lap_ms() - busy_ms / threads);
  }

  const std::map<std::string, double>& ms() const { return ms_; }

 private:
  Stopwatch watch_;
  std::map<std::string, double> ms_;
};

}  // namespace trocar::pipeline
