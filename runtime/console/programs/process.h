// SPDX-License-Identifier: Apache-2.0
// A process that this console has started, or that an earlier console or another
// program has started.
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "formats/base/result.h"

namespace trocar::runtime {

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

  Process(Process&& other) noexcept;
  Process& operator=(Process&& other) noexcept;
  ~Process();

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
  int fd_ = -1;
  bool is_child_ = false, has_ended_ = false;
  int status_ = -1;  ///< exit code; -1: no exit code is known
  int signal_ = 0;   ///< signal that ended the process; 0: none
};

}  // namespace trocar::runtime
