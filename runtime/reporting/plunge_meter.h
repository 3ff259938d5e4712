// SPDX-License-Identifier: Apache-2.0
// Measures the plunge after a break-through (definition 4 of session_figures.h).
// Tests: tests/e2e/session_report_test.py
#pragma once

#include <Eigen/Core>
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
  /// Heights of the tip, and of the tip of a tool fixed to the plate, in one row.
  struct Heights {
    double tip_m = 0, plate_m = 0;
  };
  Heights heights_of(const RecordingRow& row) const;

  Eigen::Vector3d tip_plate_m_;
  std::optional<Heights> last_;       ///< heights in the last counted row
  std::optional<BreakThrough> open_;  ///< the break-through whose plunge is being measured
  Heights from_, lowest_;             ///< before the break-through, and with the lowest tip
  std::vector<double> recent_m_;      ///< ring of the tip's heights since the break-through
  std::uint64_t ticks_ = 0, stop_ticks_ = 1, max_ticks_ = 1;
};

/// Returns the height of the sheet, or of the layer's top.
double height_of(const Punctured& what, const Scene& scene, const std::vector<ReportSheet>& sheets);

}  // namespace trocar::runtime
