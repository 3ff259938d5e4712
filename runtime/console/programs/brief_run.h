// SPDX-License-Identifier: Apache-2.0
// A program of the console's own that ends by itself, such as a test.
// Tests: tests/e2e/console_device_test.py, tests/e2e/console_new_scene_test.py
#pragma once

#include <chrono>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "formats/base/result.h"
#include "runtime/console/programs/process.h"

namespace trocar::runtime {

class BriefRun {
 public:
  using Clock = std::chrono::steady_clock;

  /// Runs words[0], and appends what it prints to `log`. The run before must have ended. Errors: (refused, unwritable) it
  /// cannot be started.
  Result<void> start(const std::vector<std::string>& words, const std::filesystem::path& log);
  bool was_started() const noexcept { return process_.has_value(); }
  bool is_running() const noexcept { return process_ && !has_ended_; }
  /// Asks the program to end. poll() kills it if it does not end within a second.
  void stop(Clock::time_point now);
  bool was_stopped() const noexcept { return stopped_at_.has_value(); }
  /// Notices the end. The caller must call this every few milliseconds.
  void poll(Clock::time_point now);
  /// None: it runs, or a signal ended it.
  std::optional<int> exit_code() const;
  /// "exit code 3" or "signal 9"; empty while it runs.
  std::string end() const { return has_ended_ ? process_->end() : std::string(); }

 private:
  std::optional<Process> process_;
  std::optional<Clock::time_point> stopped_at_;
  bool has_ended_ = false;
};

}  // namespace trocar::runtime
