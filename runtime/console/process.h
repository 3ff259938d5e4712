// SPDX-License-Identifier: Apache-2.0
// A program that the console has started, or that an earlier console has.
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "formats/base/result.h"

namespace trocar::runtime {

/// Named by a pidfd, so that no signal can reach another process that got the same number.
/// The process goes on when this is destroyed.
class Process {
 public:
  /// Runs arguments[0] with standard output and errors appended to `log`, in a process group of its
  /// own: Ctrl-C on the console's terminal does not reach it. It inherits no other descriptor.
  static Result<Process> start(const std::vector<std::string>& arguments,
                               const std::filesystem::path& log);
  /// One that runs already; `start_ticks` (field 22 of /proc/PID/stat), if given, must be its own.
  static std::optional<Process> adopt(pid_t pid, std::optional<std::uint64_t> start_ticks = {});

  Process(Process&& other) noexcept;
  Process& operator=(Process&& other) noexcept;
  ~Process();

  pid_t pid() const noexcept { return pid_; }
  std::uint64_t start_ticks() const;  ///< 0: unknown
  /// Takes note of its end. No waiting.
  bool has_ended();
  /// After its end: "exit code 3", "signal 9"; empty: unknown, since another process started it.
  std::string end() const;
  std::optional<int> exit_code() const;
  void signal(int number) const noexcept;

 private:
  Process(pid_t pid, int fd, bool is_child) : pid_(pid), fd_(fd), is_child_(is_child) {}

  pid_t pid_ = 0;
  int fd_ = -1;
  bool is_child_ = false, has_ended_ = false;
  int status_ = -1;  ///< exit code
  int signal_ = 0;   ///< that ended it
};

}  // namespace trocar::runtime
