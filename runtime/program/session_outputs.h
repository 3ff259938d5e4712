// SPDX-License-Identifier: Apache-2.0
// The files that trocar-run writes in addition to the recording: summary, meshes, frames, path of a
// live hand, and session report. A frame holds the values of a tick and, with the force law
// `network`, the deformed sheet around the tool; 30 frames are written for each second.
#pragma once

#include <filesystem>
#include <optional>
#include <vector>

#include "formats/base/result.h"
#include "runtime/device/link_report.h"
#include "runtime/devices/live_hand.h"
#include "runtime/program/run_options.h"
#include "runtime/program/session_inputs.h"
#include "runtime/reporting/session_observer.h"
#include "runtime/reporting/session_report.h"
#include "runtime/session/session.h"
#include "runtime/telemetry/frame_display.h"

namespace trocar::runtime {

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
