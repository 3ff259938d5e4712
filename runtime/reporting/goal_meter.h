// SPDX-License-Identifier: Apache-2.0
// Compares a session with its scene's goals: the distances of definition 6 in session_figures.h,
// and the result of each goal.
// Tests: tests/e2e/session_report_test.py
#pragma once

#include <vector>

#include "formats/session/recording.h"
#include "formats/session/scene.h"
#include "runtime/reporting/session_figures.h"
#include "runtime/reporting/vector3.h"

namespace trocar::runtime {

/// Returns the distance of a point from a zone in m, negative inside the zone.
double zone_distance_m(const ForbiddenZone& zone, const Vector3& p_m);

class GoalMeter {
 public:
  /// The goals must outlive this object.
  explicit GoalMeter(const SceneGoals& goals) : goals_(goals), in_zone_(goals.zones.size()) {}
  /// Takes a counted row (definition 1). `figures` has an entry for each zone.
  void observe(const RecordingRow& row, SessionFigures& figures);
  /// The next row begins new breaches.
  void interrupt() { in_zone_.assign(in_zone_.size(), false); }
  /// Adds the result of each goal; all other figures must be complete.
  void judge(SessionFigures& figures) const;

 private:
  void observe_line(const RecordingRow& row, SessionFigures& figures) const;
  void observe_zone(std::size_t index, const RecordingRow& row, ZoneFigures& figures);

  const SceneGoals& goals_;
  std::vector<bool> in_zone_;  ///< one flag per zone: the tip was inside in the last row
};

}  // namespace trocar::runtime
