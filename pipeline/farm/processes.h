// SPDX-License-Identifier: GPL-3.0-or-later
// Tasks that run in separate processes. A crash therefore ends only one task, and all memory of a
// task is returned to the system.
#pragma once

#include <sys/types.h>

#include <chrono>
#include <cstddef>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "formats/base/result.h"

namespace trocar::farm {

/// Calls fork(). If this process dies, the new process gets the signal, or ends if it has not begun
/// yet. The new process may have been forked from a process with threads.
pid_t fork_with_signal(int signal);

/// A process that has ended.
struct Ended {
  std::size_t task = 0;
  std::string text;                ///< text that `work` returned in the process
  int signal = 0;                  ///< signal that killed the process; 0: none
  int exit_code = 0;               ///< exit code of the process if no signal killed it
  std::uint64_t memory_bytes = 0;  ///< largest resident memory of the process
  double seconds = 0;
};

class Processes {
 public:
  Processes() = default;
  Processes(const Processes&) = delete;
  Processes& operator=(const Processes&) = delete;
  /// Kills the running processes and waits for them.
  ~Processes();

  /// Starts a process for a task by fork(). The new process calls work(), sends the result to the
  /// calling process, and ends. If the calling process dies, the new one is killed. Errors: kBug if
  /// no process can be created.
  Result<void> start(std::size_t task, const std::function<std::string()>& work);
  std::size_t running() const { return running_.size(); }
  /// Waits for a process to end, at most for the given time, and returns it. Returns no value
  /// if none has ended. This can happen even before the given time is over, so call the
  /// function in a loop.
  std::optional<Ended> wait(std::chrono::milliseconds most);
  /// Sends a signal to all running processes.
  void signal_all(int signal) const;

 private:
  struct Running {
    std::size_t task = 0;
    pid_t pid = 0;
    int fd = -1;
    std::string text;
    std::chrono::steady_clock::time_point start;
  };
  std::vector<Running> running_;
};

}  // namespace trocar::farm
