// SPDX-License-Identifier: Apache-2.0
// Measures the plunge after a break-through (definition 4 of session_figures.h).
// Tests: tests/e2e/session_report_test.py
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "formats/session/recording.h"
#include "formats/session/scene.h"
#include "runtime/reporting/session_figures.h"

namespace trocar::runtime {

class PlungeMeter {
 public:
  PlungeMeter(const Scene& scene, const std::vector<ReportSheet>& sheets, double rate_Hz);
  /// Takes a counted row. `punctured`: the lowest sheet or layer that is punctured in this row.
  void observe(const RecordingRow& row, const std::optional<Punctured>& punctured,
               SessionFigures& figures);
  /// Ends the measurement, if one is open, because a row is not counted.
  void interrupt(double t_s, SessionFigures& figures);
  /// Ends the measurement, if one is open.
  void end(PlungeEnd end, double t_s, SessionFigures& figures);

 private:
  void follow(const RecordingRow& row, SessionFigures& figures);

  const Scene& scene_;
  const std::vector<ReportSheet>& sheets_;
  double last_wanted_N_ = 0;
  std::optional<BreakThrough> open_;  ///< the break-through whose plunge is being measured
  double from_m_ = 0, lowest_m_ = 0;  ///< height of the tip at the break-through, and its lowest
  std::vector<double> recent_m_;      ///< ring of the tip's heights since the break-through
  std::uint64_t ticks_ = 0, stop_ticks_ = 1, max_ticks_ = 1;
};

/// Returns the height of the sheet, or of the layer's top.
double height_of(const Punctured& what, const Scene& scene, const std::vector<ReportSheet>& sheets);

}  // namespace trocar::runtime
