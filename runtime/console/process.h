// SPDX-License-Identifier: Apache-2.0
// Processes that the console starts or finds.
#pragma once

#include <sys/types.h>
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "formats/base/files.h"
#include "formats/base/result.h"

namespace trocar::runtime {

// A process that this console has started, or that an earlier console or another
// program has started.

/// Refers to a process by a pidfd (a file descriptor for a process). A process number can be given
/// to another process after the end of the first one, but a pidfd never refers to another process,
/// so a signal cannot reach a wrong one. When this object is destroyed, the process keeps running.
class Process {
 public:
  /// Starts the program arguments[0]. Its standard output and standard error are appended to `log`,
  /// its standard input is /dev/null, and it inherits no other file descriptor. The process has a
  /// process group of its own, so Ctrl-C on the console's terminal does not reach it. Errors:
  /// kRefused if the program cannot be started.
  static Result<Process> start(const std::vector<std::string>& arguments,
                               const std::filesystem::path& log);
  /// Refers to a process that already runs. `start_ticks`: the start time that the process must
  /// have (start_ticks()), so that no later process with the same number is taken for it. Returns
  /// nullopt if no process with this number runs, or if the start time differs.
  static std::optional<Process> adopt(pid_t pid, std::optional<std::uint64_t> start_ticks = {});

  pid_t pid() const noexcept { return pid_; }
  /// Start time in clock ticks since the system's start (field 22 of /proc/PID/stat); 0: unknown.
  std::uint64_t start_ticks() const;
  /// Returns true if the process has ended. Does not wait.
  bool has_ended();
  /// Returns how the process ended, such as "exit code 3" or "signal 9". The text is empty until
  /// has_ended() returns true. It stays empty for a process of adopt(), because the system reports
  /// the end of a process only to the process that started it.
  std::string end() const;
  /// Returns the exit code. Returns nullopt if the process runs, if a signal ended it, or if
  /// its end is not known.
  std::optional<int> exit_code() const;
  void signal(int number) const noexcept;

 private:
  Process(pid_t pid, int fd, bool is_child) : pid_(pid), fd_(fd), is_child_(is_child) {}

  pid_t pid_ = 0;
  FileDescriptor fd_;
  bool is_child_ = false, has_ended_ = false;
  int status_ = -1;  ///< exit code; -1: no exit code is known
  int signal_ = 0;   ///< signal that ended the process; 0: none
};

// Runs a program that ends by itself, such as the test of a device.

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
  std::optional<int> exit_code() const { return has_ended_ ? process_->exit_code() : std::nullopt; }
  /// Returns how the program ended, such as "exit code 3" or "signal 9". Empty if it has not ended.
  std::string end() const { return has_ended_ ? process_->end() : std::string(); }

 private:
  std::optional<Process> process_;
  std::optional<Clock::time_point> stopped_at_;
  bool has_ended_ = false;
};

}  // namespace trocar::runtime
