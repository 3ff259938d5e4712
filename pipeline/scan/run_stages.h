// SPDX-License-Identifier: GPL-3.0-or-later
// Adds up the time that each stage of a run takes, for stages_ms in the report.
#pragma once

#include <algorithm>
#include <map>
#include <string>

#include "pipeline/base/stopwatch.h"

namespace trocar::pipeline {

class RunStages {
 public:
  explicit RunStages(Stopwatch::TimePoint start) : watch_(start) {}

  /// Ends a lap and adds its duration to the stage. The first lap begins at `start`, every other
  /// one when the lap before ends.
  void lap(const char* stage) { ms_[stage] += watch_.lap_ms(); }

  /// Ends a lap in which several threads worked on several stages. `thread_ms` has the time of each
  /// stage, summed over all threads; this sum, divided by the number of threads, is added to the
  /// stage. `busy_ms` is the time in which threads were busy, summed over all threads. The duration
  /// of the lap minus busy_ms / threads is added to the stage `idle`. Busy time that belongs to no
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
