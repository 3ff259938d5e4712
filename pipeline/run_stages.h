// SPDX-License-Identifier: GPL-3.0-or-later
// Where the time of a run went: the report's stages_ms.
#pragma once

#include <algorithm>
#include <map>
#include <string>

#include "pipeline/stopwatch.h"

namespace trocar::pipeline {

class RunStages {
 public:
  explicit RunStages(Stopwatch::TimePoint start) : watch_(start) {}

  /// What has been done since the last lap.
  void lap(const char* stage) { ms_[stage] += watch_.lap_ms(); }

  /// What several threads have done since the last lap, `busy_ms` of all together: each stage has
  /// the time of all threads, divided by their number; `idle` is what no thread was busy with. Busy
  /// time that belongs to no stage is in none: then the stages add up to less than the run.
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
