// SPDX-License-Identifier: Apache-2.0
// Signals that stop or end a process at once by default, while a session runs. A device keeps its
// last command for a while, so forces must be zero first.
//  - SIGTSTP (Ctrl-Z), SIGTTIN, SIGTTOU: the session is paused as by the operator. Once zero force
//    was written, the process stops. After SIGCONT the session is still paused: it goes on after a
//    resume or a request for recovery.
//  - SIGQUIT, SIGXCPU, SIGALRM and the like: the session ends as after Ctrl-C.
#pragma once

#include "runtime/realtime/realtime_thread.h"
#include "runtime/session/session_options.h"

namespace trocar::runtime {

class SuspendingSignals {
 public:
  /// Catches the signals. Only one object may exist at a time. `loop_cpu`: the haptic thread's
  /// processor, which the object's thread keeps off; -1: any.
  explicit SuspendingSignals(int loop_cpu);
  /// Gives the signals that stop the process their default effect again.
  ~SuspendingSignals();
  SuspendingSignals(const SuspendingSignals&) = delete;
  SuspendingSignals& operator=(const SuspendingSignals&) = delete;

  /// For SessionOptions::suspension.
  static Suspension& suspension() noexcept;

 private:
  void serve();
  int avoided_cpu_;  ///< until the thread keeps off it; then -1
  PollingThread thread_;
};

}  // namespace trocar::runtime
