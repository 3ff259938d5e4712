// SPDX-License-Identifier: Apache-2.0
// A program that this console, or an earlier one, has started.
// Tests: tests/runtime/console/console_test.cpp
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "formats/base/result.h"

namespace trocar::runtime {

/// Refers to a process by a pidfd, so no signal can reach another process that got the same number.
/// The process keeps running when this object is destroyed.
class Process {
 public:
  /// Runs arguments[0], and appends its standard output and standard error to `log`. The process
  /// has a process group of its own, so Ctrl-C on the console's terminal does not reach it. It
  /// inherits no other descriptor.
  static Result<Process> start(const std::vector<std::string>& arguments,
                               const std::filesystem::path& log);
  /// Returns a process that already runs. If `start_ticks` is given, it must equal field
  /// 22 of /proc/PID/stat.
  static std::optional<Process> adopt(pid_t pid, std::optional<std::uint64_t> start_ticks = {});

  Process(Process&& other) noexcept;
  Process& operator=(Process&& other) noexcept;
  ~Process();

  pid_t pid() const noexcept { return pid_; }
  std::uint64_t start_ticks() const;  ///< field 22 of /proc/PID/stat; 0: unknown
  /// Returns true if the process has ended. Does not wait.
  bool has_ended();
  /// After the end of the process, returns "exit code 3" or "signal 9"; empty if another
  /// console started it.
  std::string end() const;
  std::optional<int> exit_code() const;
  void signal(int number) const noexcept;

 private:
  Process(pid_t pid, int fd, bool is_child) : pid_(pid), fd_(fd), is_child_(is_child) {}

  pid_t pid_ = 0;
  int fd_ = -1;
  bool is_child_ = false, has_ended_ = false;
  int status_ = -1;  ///< exit code; -1: none
  int signal_ = 0;   ///< signal that ended the process; 0: none
};

}  // namespace trocar::runtime
