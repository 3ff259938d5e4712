// SPDX-License-Identifier: Apache-2.0
// Runs a program that ends by itself, such as the test of a device.
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

  /// Starts the program words[0] with words[1] and the following words as arguments. The program's
  /// output is appended to `log`. Precondition: is_running() is false. Errors: kRefused if the
  /// program cannot be started.
  Result<void> start(const std::vector<std::string>& words, const std::filesystem::path& log);
  bool was_started() const noexcept { return process_.has_value(); }
  bool is_running() const noexcept { return process_ && !has_ended_; }
  /// Asks the program to end. If the program does not end within a second,
  /// poll() kills the program.
  void stop(Clock::time_point now);
  bool was_stopped() const noexcept { return stopped_at_.has_value(); }
  /// Checks whether the program has ended. The caller must call this every few milliseconds.
  void poll(Clock::time_point now);
  /// Returns the exit code of the program. Returns nullopt if the program was not started, still
  /// runs, or was ended by a signal.
  std::optional<int> exit_code() const;
  /// Returns how the program ended, such as "exit code 3" or "signal 9". Empty if it has not ended.
  std::string end() const { return has_ended_ ? process_->end() : std::string(); }

 private:
  std::optional<Process> process_;
  std::optional<Clock::time_point> stopped_at_;
  bool has_ended_ = false;
};

}  // namespace trocar::runtime
