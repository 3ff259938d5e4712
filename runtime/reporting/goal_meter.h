// SPDX-License-Identifier: Apache-2.0
// Compares a session with its scene's goals. Measures the tip's distances to the target, to the
// planned line and to the zones (session_figures.h, definition 6), and determines which goals were
// met in the session.
#pragma once

#include <vector>

#include "formats/session/recording.h"
#include "formats/session/scene.h"
#include "runtime/reporting/session_figures.h"

namespace trocar::runtime {

class GoalMeter {
 public:
  /// The goals must outlive this object.
  explicit GoalMeter(const SceneGoals& goals) : goals_(goals), in_zone_(goals.zones.size()) {}
  /// Call this for each counted row: a row in the safety state `ready` or `running`
  /// (session_figures.h). Precondition: figures.zones has an entry for each zone.
  void observe(const RecordingRow& row, SessionFigures& figures);
  /// Call this for each row that is not counted. It ends all breaches (stays of the tip in zones),
  /// so that the next row in a zone begins a new breach.
  void interrupt() { in_zone_.assign(in_zone_.size(), false); }
  /// Adds the result of each goal to `figures`. Precondition: all other figures are complete.
  void judge(SessionFigures& figures) const;

 private:
  void observe_line(const RecordingRow& row, SessionFigures& figures) const;
  void observe_zone(std::size_t index, const RecordingRow& row, ZoneFigures& figures);

  const SceneGoals& goals_;
  std::vector<bool> in_zone_;  ///< flag of each zone: the tip was in the zone in the previous row
};

}  // namespace trocar::runtime
