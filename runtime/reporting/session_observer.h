// SPDX-License-Identifier: Apache-2.0
// Collects the figures of a session (session_figures.h) tick by tick.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "formats/session/held_stops.h"
#include "formats/session/scene.h"
#include "runtime/reporting/goal_meter.h"
#include "runtime/reporting/plunge_meter.h"
#include "runtime/reporting/session_figures.h"
#include "runtime/reporting/tremor_meter.h"
#include "runtime/reporting/vector3.h"
#include "runtime/telemetry/tick_feed.h"

namespace trocar::runtime {

class SessionObserver {
 public:
  /// The scene must outlive this object.
  SessionObserver(const Scene& scene, std::vector<ReportSheet> sheets, double rate_Hz);
  SessionObserver(const SessionObserver&) = delete;
  SessionObserver& operator=(const SessionObserver&) = delete;

  /// Call this for each tick of the session, in order.
  void observe(const ObservedTick& tick);
  /// Returns the figures. Call it once, after the last tick.
  SessionFigures figures();

 private:
  void observe_counted(const ObservedTick& tick, double force_N);
  void observe_gap();
  void observe_path(const ObservedTick& tick);
  void observe_attempt(const RecordingRow& row);
  void observe_punctures(const ObservedTick& tick);
  void observe_miss(const RecordingRow& row);
  /// The tip has passed the bone: the doubtful misses were misses.
  void count_doubtful();
  void observe_fault(const RecordingRow& row);
  std::optional<double> front_HU(const RecordingRow& row) const;
  void sample(const RecordingRow& row, double force_N);

  const Scene& scene_;
  std::vector<ReportSheet> sheets_;
  SessionFigures out_;
  PlungeMeter plunge_;
  TremorMeter tremor_;
  std::optional<GoalMeter> goals_;
  // The values of the previous row. If the previous row was not counted, last_tip_ is none.
  double last_hand_N_ = 0, last_t_s_ = 0;
  std::optional<double> last_front_HU_;
  std::optional<Vector3> last_tip_;
  // contact_tip_: position of the tip in the first row in contact. length_since_contact_m_: length
  // of the tip's path since that row. lowest_inserted_m_: the tip's lowest height since that row.
  Vector3 contact_tip_{};
  double length_since_contact_m_ = 0, lowest_inserted_m_ = 0;
  /// Position of the tip in the last row in bone; none: the tip has left the bone, or has not
  /// reached the bone.
  std::optional<Vector3> in_bone_tip_;
  /// Greatest height of the tip in bone since it was last above all sheets and layers.
  std::optional<double> surface_z_m_;
  struct Misses {
    Spans spans;
    std::uint64_t ticks = 0;
  };
  Misses sure_, doubtful_;   ///< doubtful: rows before the tip has entered bone
  bool is_missed_ = false;   ///< the previous row was counted and has the contact state `beside`
  bool is_counted_ = false;  ///< the previous row belongs to a miss, perhaps a doubtful one
  /// In the previous row, which was counted, only soft layers exerted a force.
  bool is_in_layers_ = false;
  std::int32_t missed_slice_ = -1;
  FaultStarts fault_starts_;
  std::uint64_t rows_sampled_ = 0;
};

}  // namespace trocar::runtime
