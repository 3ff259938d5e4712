// SPDX-License-Identifier: Apache-2.0
// Measures the plunges after break-throughs (law 6 of runtime/control/break_through.h).
#pragma once

#include <cstdint>
#include <vector>

#include "formats/session/recording.h"
#include "formats/session/scene.h"
#include "runtime/control/break_through.h"
#include "runtime/reporting/session_figures.h"

namespace trocar::runtime {

class PlungeMeter {
 public:
  /// `scene` and `sheets` must outlive this object.
  PlungeMeter(const Scene& scene, const std::vector<ReportSheet>& sheets, double rate_Hz);
  /// Call this for each row in order. A row that is not in `running` ends all measurements.
  void observe(const RecordingRow& row, const BreakThroughTick& tick, SessionFigures& figures);
  /// Ends all measurements, and adds their plunges and break-throughs to `figures`.
  void end(PlungeEnd end, double t_s, SessionFigures& figures);

 private:
  /// A fall of the resistance whose plunge is being measured.
  struct Open {
    BreakThrough made;
    bool is_break_through = false;
    double reference_N = 0, lowest_z_m = 0;
    std::uint64_t ticks_left = 0;
  };
  void close(const Open& open, PlungeEnd end, double t_s, SessionFigures& figures) const;

  const Scene& scene_;
  const std::vector<ReportSheet>& sheets_;
  std::uint64_t max_ticks_ = 1;
  std::vector<Open> open_;  ///< the oldest first
};

/// Returns the height of a punctured sheet, or of the top of a punctured layer.
double height_of(const Punctured& what, const Scene& scene, const std::vector<ReportSheet>& sheets);

}  // namespace trocar::runtime
