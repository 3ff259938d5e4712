// SPDX-License-Identifier: Apache-2.0
// What trocar-run prints about a session: progress, messages, its outcome and its problems.
// Tests: tests/e2e/told_e2e_test.py
#pragma once

#include <chrono>
#include <string>
#include <vector>

#include "formats/base/result.h"
#include "runtime/program/run_arguments.h"
#include "runtime/realtime/triple_buffer.h"
#include "runtime/session/session.h"
#include "runtime/telemetry/tick_observer.h"

namespace trocar::runtime {

/// Prints the error and returns its exit code.
int fail(const Error& error);

/// Prints a warning about the scene.
void warn(const RunArguments& arguments, const std::string& what);

/// A line on the terminal while a session in real time runs.
class Progress final : public TickObserver {
 public:
  explicit Progress(double duration_s)
      : TickObserver(std::chrono::milliseconds(100)), duration_s_(duration_s) {}
  ~Progress() override { stop(); }

  void on_tick(const TickView& tick) noexcept override { latest_.write(tick.result.row); }
  void serve() override;
  /// Also clears the line.
  void stop() override;

 private:
  TripleBuffer<RecordingRow> latest_;
  double duration_s_;
};

/// Prints the message at once, in place of the progress line on a terminal.
void print_message(const RunArguments& arguments, const OperatorMessage& message);

void print_outcome(const SessionReport& report, const SessionOptions& options);

/// Prints one line for each problem and returns the exit code. A fault's exit code takes
/// precedence, because the operator of the device must learn of it. In a replay, which has no
/// device, torques that differ take precedence.
int conclude(const SessionReport& report, std::vector<Error> errors, const Remesher& remesher);

}  // namespace trocar::runtime
