// SPDX-License-Identifier: GPL-3.0-or-later
// Pieces of work, each in a process of its own: a crash ends that process only, and all memory is
// given back.
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

/// A process that has ended.
struct Ended {
  std::size_t piece = 0;
  std::string text;   ///< that it sent
  int signal = 0;     ///< that killed it
  int exit_code = 0;  ///< if none did
  double seconds = 0;
};

class Processes {
 public:
  Processes() = default;
  Processes(const Processes&) = delete;
  Processes& operator=(const Processes&) = delete;
  /// Kills and collects what still runs.
  ~Processes();

  /// Begins a process, which sends what `work` returns. It is killed if this one dies. Errors
  /// (bug): no process can be made.
  Result<void> begin(std::size_t piece, const std::function<std::string()>& work);
  std::size_t running() const { return running_.size(); }
  /// Waits for a process to end, or for the time to pass.
  std::optional<Ended> wait(std::chrono::milliseconds most);
  /// Sends a signal to all.
  void signal_all(int signal) const;

 private:
  struct Running {
    std::size_t piece = 0;
    pid_t pid = 0;
    int fd = -1;
    std::string text;
    std::chrono::steady_clock::time_point start;
  };
  std::vector<Running> running_;
};

}  // namespace trocar::farm
