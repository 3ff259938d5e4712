// SPDX-License-Identifier: Apache-2.0
// What trocar-run prints about a session, and the files that it writes besides the recording.
#pragma once

#include <chrono>
#include <optional>
#include <string>
#include <vector>

#include "formats/base/result.h"
#include "runtime/device/device.h"
#include "runtime/program/run_options.h"
#include "runtime/program/session_inputs.h"
#include "runtime/realtime/queues.h"
#include "runtime/report/session_observer.h"
#include "runtime/report/session_report.h"
#include "runtime/session/live_hand.h"
#include "runtime/session/recorder.h"
#include "runtime/session/session.h"
#include "runtime/session/session_publisher.h"

namespace trocar::runtime {

// Prints what trocar-run reports about a session: progress, messages, the outcome, and problems.

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

// The files that trocar-run writes in addition to the recording: summary, meshes, frames, path of a
// live hand, and session report. A frame holds the values of a tick and, with the force law
// `network`, the deformed sheet around the tool; 30 frames are written for each second.

/// Checks the names of the outputs. Errors: kUsage if two outputs have the same name, or if an
/// output is also an input; kUnwritable if an output cannot be written.
Result<void> check_run_outputs(const RunArguments& arguments, const SessionInputs& inputs);

class SessionOutputs {
 public:
  /// The references must outlive this object.
  SessionOutputs(const RunArguments& arguments, const SessionInputs& inputs, double rate_Hz);

  /// Makes this object collect frames and the report's numbers during the session. If the arguments
  /// ask for frames, sets SessionOptions::on_frame. If they ask for a report, sets
  /// SessionOptions::on_tick.
  void collect(SessionOptions& options);
  /// Writes every output, even if another output could not be written. Returns the errors, and also
  /// the error of the recording, which the session has written. `hand`: the hand that a person
  /// moved; null: the scene has no live hand. `link`: counts of the packets on the device link;
  /// none: the device has no link.
  std::vector<Error> write(const SessionOptions& options, const SessionResult& report,
                           const Remesher& remesher, const LiveHand* hand,
                           const std::optional<LinkReport>& link);

 private:
  ReportFacts facts(const SessionFigures& figures, const SessionOptions& options,
                    const SessionResult& report, const Remesher& remesher) const;

  const RunArguments& arguments_;
  const SessionInputs& inputs_;
  std::vector<ReportSheet> sheets_;
  FrameWriter frames_;
  SessionObserver observer_;
};

}  // namespace trocar::runtime
