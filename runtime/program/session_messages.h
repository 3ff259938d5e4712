// SPDX-License-Identifier: Apache-2.0
// Prints what trocar-run reports about a session: progress, messages, the outcome, and problems.
#pragma once

#include <chrono>
#include <string>
#include <vector>

#include "formats/base/result.h"
#include "runtime/program/run_options.h"
#include "runtime/realtime/triple_buffer.h"
#include "runtime/session/session.h"
#include "runtime/telemetry/tick_observer.h"

namespace trocar::runtime {

/// Prints the error, and returns the exit code that belongs to this error.
int fail(const Error& error);

/// Prints a warning with the name of the scene's file.
void warn(const RunArguments& arguments, const std::string& what);

/// Shows a progress line on the terminal while a session runs in real time.
class Progress final : public TickObserver {
 public:
  explicit Progress(double duration_s)
      : TickObserver(std::chrono::milliseconds(100)), duration_s_(duration_s) {}
  ~Progress() override { stop(); }

  void on_tick(const TickView& tick) noexcept override { latest_.write(tick.result.row); }
  void serve() override;
  /// Like TickObserver::stop(); also clears the line.
  void stop() override;

 private:
  TripleBuffer<RecordingRow> latest_;
  double duration_s_;
};

/// Prints the message immediately. On a terminal the message replaces the progress line.
void print_message(const RunArguments& arguments, const OperatorMessage& message);

/// Prints what happened in the session: ticks, missed deadlines, largest values, and punctures.
void print_outcome(const SessionResult& report, const SessionOptions& options);

/// Prints one line for each problem and each black box, and returns the exit code. `errors`: the
/// errors of writing the outputs. If the torques of a replay differ from those of the recording,
/// the exit code is kRefused whatever else failed. Otherwise, if a fault ended the session, the
/// exit code is kDeviceFault, because the operator must learn of the fault first of all.
int conclude(const SessionResult& report, std::vector<Error> errors, const Remesher& remesher);

}  // namespace trocar::runtime
