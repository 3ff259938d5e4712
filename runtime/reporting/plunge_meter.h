// SPDX-License-Identifier: Apache-2.0
// Measures the plunge: how far the tip moves down after it has broken through a sheet or through a
// layer of soft tissue (definition 4 of session_figures.h).
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
  /// `scene` and `sheets` must outlive this object.
  PlungeMeter(const Scene& scene, const std::vector<ReportSheet>& sheets, double rate_Hz);
  /// Call this for each counted row, that is for each row with the safety state `ready` or
  /// `running` (definition 1 of session_figures.h). `punctured`: the lowest sheet or layer that is
  /// punctured in this row; none: nothing is punctured.
  void observe(const RecordingRow& row, const std::optional<Punctured>& punctured,
               SessionFigures& figures);
  /// Call this for each row that is not counted. If a plunge is being measured, ends the
  /// measurement with the reason kFault.
  void interrupt(double t_s, SessionFigures& figures);
  /// If a plunge is being measured, ends the measurement and adds the break-through to `figures`.
  void end(PlungeEnd end, double t_s, SessionFigures& figures);

 private:
  void follow(const RecordingRow& row, SessionFigures& figures);

  const Scene& scene_;
  const std::vector<ReportSheet>& sheets_;
  double last_wanted_N_ = 0;
  /// Heights in one row. `tip_m`: the height of the tip. `plate_m`: the height that the tip would
  /// have at the same pose of the plate if the connection between plate and tool were rigid, that
  /// is without the coupling.
  struct Heights {
    double tip_m = 0, plate_m = 0;
  };
  Heights heights_of(const RecordingRow& row) const;

  Eigen::Vector3d tip_plate_m_;
  std::optional<Heights> last_;       ///< heights in the last counted row
  std::optional<BreakThrough> open_;  ///< the break-through whose plunge is being measured
  /// Heights in the row before the break-through, and in the row with the lowest tip since then.
  Heights from_, lowest_;
  std::vector<double> recent_m_;  ///< ring buffer: heights of the tip in the last stop_ticks_ rows
  // ticks_: number of rows since the break-through. stop_ticks_: number of rows in kPlungeStop_s; a
  // plunge has stopped if the tip hardly moved down in this time. max_ticks_: number of rows in
  // kPlunge_s, the longest time for which a plunge is measured.
  std::uint64_t ticks_ = 0, stop_ticks_ = 1, max_ticks_ = 1;
};

/// Returns the height of a punctured sheet, or of the top of a punctured layer.
double height_of(const Punctured& what, const Scene& scene, const std::vector<ReportSheet>& sheets);

}  // namespace trocar::runtime
