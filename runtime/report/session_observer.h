// SPDX-License-Identifier: Apache-2.0
// A session's figures for the debriefing: definitions, meters and the observer that collects them.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "formats/session/faults.h"
#include "formats/session/recording.h"
#include "formats/session/scene.h"
#include "runtime/haptics/loop/break_through.h"
#include "runtime/haptics/sheet.h"
#include "runtime/session/recorder.h"

namespace trocar::runtime {

// Points and vectors with three coordinates, in the form used by recordings and scenes.

using Vector3 = std::array<double, 3>;

inline Vector3 minus(const Vector3& a, const Vector3& b) noexcept {
  return {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
}
inline double dot(const Vector3& a, const Vector3& b) noexcept {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}
inline double length(const Vector3& a) noexcept {
  return std::sqrt(dot(a, a));
}

// Finds the parts of a straight line in the x-y plane at which a sheet, seen from above, has
// material. The pictures of a session report show this material.

/// Returns the intervals [from, to] of the line that lie over material, in ascending order, in m
/// in {B}. If `axis` is 0, the line is y = at_m, and the intervals are intervals of x. If `axis` is
/// 1, the line is x = at_m, and the intervals are intervals of y.
std::vector<std::array<double, 2>> material_along(const Sheet& sheet, int axis, double at_m);

// The figures of a session for the debriefing (`trocar-run --session-report`). The figures depend
// only on the session's ticks, its scene and the heights of its sheets, so a replay gives the same
// figures. The memory that the figures need does not grow with the length of the session.
//
// Definitions (formats/session/session_report.schema.json repeats them for its fields):
//  1. A row is counted if its safety state is `ready` or `running`. In other states the pose may be
//     that of an earlier tick. The figures are computed from the counted rows only. Exceptions are
//     the largest force, the faults, the samples of the force (ReportSample), the total time, and
//     the time of the rows that are not counted. A duration is a number of rows divided by the
//     rate. The force is the magnitude of the delivered force.
//  2. The first contact is the first row with the contact state `contact` or with a puncture: a
//     sheet or layer can be reached and punctured in the same tick. The insertion begins with this
//     row. It ends with the row with the lowest tip among the later rows. Straightness is the
//     distance between the tip's positions in these two rows, divided by the length of the tip's
//     path between these rows.
//  3. The force of a puncture is the force of the row before the puncture. The depth of a puncture
//     is the depth of the tip below the undeformed sheet. If a layer of soft tissue is punctured,
//     it is the depth of the tip below the top of this layer.
//  4. Break-throughs and plunges: runtime/haptics/loop/break_through.h. The part of a plunge that is
//     motion of the hand is the same sum with the way of a tip that is rigidly fixed to the plate.
//     The rest is the release: the coupling between plate and tool relaxes.
//  5. Tremor is measured with two Butterworth filters of the second order in series: a high-pass
//     with the corner frequency f = kTremorLow_Hz, followed by a low-pass with f = kTremorHigh_Hz.
//     The input of the high-pass is the tip's position minus the tip's position in the first row
//     after the filters were reset. For each filter, let x be the input and y the output in this
//     row, x1 and y1 those in the previous row, and x2 and y2 those in the row before the previous:
//       y = (b0 x + b1 x1 + b2 x2 - a1 y1 - a2 y2) / a0, where
//       w = 2 pi f / rate, alpha = sin(w) / sqrt(2),
//       a0 = 1 + alpha, a1 = -2 cos(w), a2 = 1 - alpha;
//       high-pass: b0 = b2 = (1 + cos(w)) / 2, b1 = -(1 + cos(w));
//       low-pass: b0 = b2 = (1 - cos(w)) / 2, b1 = 1 - cos(w).
//     The output of the low-pass is a vector. Tremor is the RMS of the length of its part across
//     the needle's axis in this row: steps of cutting lie along the axis, and do not count. It is
//     computed once over the rows with the contact state `free`, and once over those with
//     `contact`. Each row that is not counted resets the filters. The first kTremorSettle_s after
//     the start and after each reset are left out.
//  6. The distance to the planned line is measured in rows in which the tip has passed the entry
//     point in the line's direction. A zone is a volume in which the tip must not be. The
//     distance of the tip to a zone is negative inside the zone. A breach consists of successive
//     rows with a negative distance.
//  7. A miss consists of successive rows with the contact state `beside` at one slice, below the
//     surface. Since the tip was last above all sheets and layers (state `free`), the surface is the
//     greatest height at which it was in bone, and rows more than kLeave_m above that are no miss.
//     Rows before the tip was in bone are no miss either, unless it is `free` again, or the session
//     ends, before it is in bone. So air above bone on an oblique path is no miss, and a way that
//     passes the bone is one.
//  8. A counted row is in bone if its contact state is `contact` or `punctured` and its active
//     slice (RecordingRow::active_slice) is not -1. The tip has left the bone when, in a counted
//     row not in bone, the tip is at least kLeave_m away from its position in the last row in bone.
//     An attempt begins with the first row in bone, and with the first row in bone after the tip
//     has left the bone. Exception: no attempt begins if the tip comes back into the bone from
//     below. This is so if three conditions hold. There was an attempt before. The row directly
//     before this first row in bone is counted, and the tip moves up between the two rows. The row
//     directly before shows that the tip was below the bone: it has the contact state `beside`, or
//     it has `contact` with a soft layer (no active slice) and the first row in bone has
//     `punctured`. Every attempt after the first one is a re-entry into the bone.
//  9. The force-time integral is the sum of the force over the counted rows, divided by the rate.
// 10. The final position is the tip's position in the counted row in which the tip is lowest. If
//     several rows have the same height, it is the position in the first of them. measure_wall_violation()
//     defines how far the tool is outside bone at this position.
// 11. With the force law `cutting`, each puncture and each sample has an HU value in addition to
//     its force: the mean HU of the uncut bone under the tool (RecordingRow::Cutting::front_HU) in
//     the row of this force.
// 12. FaultStarts (faults.h) defines when a fault begins.

inline constexpr double kTremorLow_Hz = 4, kTremorHigh_Hz = 12, kTremorSettle_s = 0.5;
inline constexpr double kLeave_m = 1e-3;
inline constexpr std::size_t kMaxReportPunctures = 1024;
/// Each of these lists has at most kMaxReportSpans entries: misses, side cuts, attempts, faults,
/// and the breaches of each zone.
inline constexpr std::size_t kMaxReportSpans = 64;
inline constexpr std::size_t kMaxReportSamples = 1024;

/// The first kMax of some values, and the number of all of them.
template <typename T, std::size_t kMax>
struct Counted {
  std::vector<T> list;
  std::uint64_t count = 0;
  void add(T value) {
    if (++count <= kMax) list.push_back(std::move(value));
  }
  /// Returns the value that was added last, or null if it is not in the list.
  T* last() { return count > 0 && count <= kMax ? &list.back() : nullptr; }
};

/// A sheet of the scene. Lists of sheets begin with the topmost one.
struct ReportSheet {
  int slice = 0;
  double z_m = 0;
  std::string tissue;  ///< empty: the tissue has no name
};

/// A sheet, or a soft layer, that was punctured.
struct Punctured {
  bool is_layer = false;
  std::size_t index = 0;  ///< index into Scene::layers if is_layer, otherwise into the sheets
};
struct ReportPuncture {
  Punctured what;
  // Three values are those of the row before the puncture: hand_N (force on the hand), tip_N
  // (RecordingRow::tip_N) and front_HU (definition 11).
  double t_s = 0, hand_N = 0, tip_N = 0, depth_m = 0, tip_z_m = 0;
  std::optional<double> front_HU;
};
/// The event that ended the measurement of a plunge. kReversed: the tip came back by more than
/// kBreakBack_m. kFault: a row that is not in `running`.
enum class PlungeEnd : std::uint8_t { kTime, kReversed, kFault, kEnd };
struct BreakThrough {
  std::optional<Punctured> what;  ///< punctured last; none: nothing was
  double t_s = 0, plunge_m = 0;
  double tip_N = 0;   ///< the resistance before it: P of break_through.h
  double hand_m = 0;  ///< the part of the plunge that is motion of the hand
  /// Depth of the lowest tip below the sheet, or below the layer's bottom.
  std::optional<double> below_m;
  double lowest_t_s = 0, ended_t_s = 0;  ///< time of the lowest tip, end of the measurement
  PlungeEnd ended_by = PlungeEnd::kEnd;
};
struct Tremor {
  std::uint64_t ticks = 0;  ///< number of rows in the sum
  double squares_m2 = 0;    ///< sum of the squared length across the axis (definition 5)
};
/// Successive rows that belong together: a breach, a miss, an attempt or a side cut.
struct Span {
  int slice = -1;                     ///< slice index of a miss or a side cut; otherwise -1
  double from_s = 0, to_s = 0;        ///< times of the first and the last row
  double depth_m = 0, depth_t_s = 0;  ///< largest depth of a breach, and its time
};
using Spans = Counted<Span, kMaxReportSpans>;
struct ZoneFigures {
  std::optional<double> min_m;  ///< smallest distance of the tip to the zone
  double min_t_s = 0;
  Spans breaches;
};
struct ReportFault {
  Fault fault = Fault::kNone;
  double t_s = 0;
  std::optional<double> recovered_s;  ///< time of the recovery from this fault; none: no recovery
};
struct GoalResult {
  std::string goal;
  std::string zone;  ///< name of the zone, if the goal belongs to a zone
  double limit = 0;
  bool at_least = false;  ///< true: limit is the smallest allowed value; false: the largest one
  std::optional<double> value;
  const char* unit = "m";
  /// False: the goal was never tried. Without contact only a target that was reached and a zone that
  /// was entered are tried; without a break-through no plunge; without a row beyond the entry point
  /// neither entry nor corridor.
  bool attempted = false;
  bool met = false;  ///< implies `attempted`
  std::string how;   ///< description of the value and its limit
};
/// The row with the largest force among SessionFigures::stride successive rows.
struct ReportSample {
  double t_s = 0;
  std::array<double, 3> tip_m{};
  double hand_N = 0;
  std::optional<double> front_HU;
};

struct SessionFigures {
  double rate_Hz = 0;
  // Numbers of rows. ticks: all rows. counted: counted rows. free: counted rows with the contact
  // state `free`. contact: those with `contact`. through: those with `punctured` or `beside`.
  std::uint64_t ticks = 0, counted = 0, free = 0, contact = 0, through = 0;
  double top_z_m = 0;   ///< height of the highest sheet or layer; the tip's depth begins here
  double length_m = 0;  ///< length of the tip's path
  // The insertion (definition 2). insertion_m: length of the tip's path between the two rows.
  // straight_m: distance between the tip's positions in these two rows.
  std::optional<double> insertion_m, straight_m;
  double lowest_z_m = 0;
  std::array<double, 3> lowest_m{};            ///< position of the lowest tip
  std::array<double, 4> lowest_q{1, 0, 0, 0};  ///< orientation of the plate at lowest_t_s, w x y z
  double lowest_t_s = 0;                       ///< time of the lowest tip
  Spans attempts;                              ///< each from its first to its last row in bone
  std::optional<double> first_contact_s, last_puncture_s;
  // The largest force with its time, and the sums of the force over the rows in contact and over
  // all counted rows.
  double force_max_N = 0, force_max_t_s = 0, contact_sum_N = 0, counted_sum_N = 0;
  std::array<double, 3> force_max_tip_m{};
  Counted<ReportPuncture, kMaxReportPunctures> punctures;
  Counted<BreakThrough, kMaxReportPunctures> break_throughs;
  double plunge_max_m = 0;  ///< of all falls of the resistance, also if none is a break-through
  Tremor tremor_free, tremor_contact;
  // The planned line (definition 6). line_ticks: number of rows in which the tip's distance to the
  // line is measured. line_max_m: largest distance. line_squares_m2: sum of the squared distances.
  // line_entry_m: distance in the first of these rows.
  std::uint64_t line_ticks = 0;
  double line_max_m = 0, line_squares_m2 = 0, line_entry_m = 0;
  // target_m: smallest distance of the tip to the target. target_reached_s: time at which the tip
  // was first within the target's radius.
  std::optional<double> target_m, target_reached_s;
  double target_t_s = 0;           ///< time of the smallest distance
  std::vector<ZoneFigures> zones;  ///< in the order of SceneGoals::zones
  Spans misses;
  std::uint64_t missed_ticks = 0;
  /// A side cut is an event at which the wall of a hole yielded. Only `slice` and the times are set.
  Spans side_cuts;
  Counted<ReportFault, kMaxReportSpans> faults;
  std::uint64_t operator_stops_count = 0;  ///< how often the operator paused or switched forces off
  std::vector<ReportSample> samples;
  std::uint64_t stride = 1;       ///< number of rows for which each sample stands
  std::vector<GoalResult> goals;  ///< in the order of SceneGoals
};

/// Returns the number of ticks in a duration, at least 1.
inline std::uint64_t ticks_of(double duration_s, double rate_Hz) {
  return static_cast<std::uint64_t>(std::max(1.0, std::round(duration_s * rate_Hz)));
}

// Compares a session with its scene's goals. Measures the tip's distances to the target, to the
// planned line and to the zones (definition 6), and determines which goals were
// met in the session.

class GoalMeter {
 public:
  /// The goals must outlive this object.
  explicit GoalMeter(const SceneGoals& goals) : goals_(goals), in_zone_(goals.zones.size()) {}
  /// Call this for each counted row: a row in the safety state `ready` or `running`
  /// Precondition: figures.zones has an entry for each zone.
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

// Measures the plunges after break-throughs (law 6 of runtime/haptics/loop/break_through.h).

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

// Measures the tremor of the tip (definition 5).

class TremorMeter {
 public:
  TremorMeter(const Scene& scene, double rate_Hz);
  /// Call this for each counted row (definition 1). Filters the tip's
  /// position, and adds the squares of the output to the sums in `figures`.
  void observe(const RecordingRow& row, SessionFigures& figures);
  /// Call this for each row that is not counted. Resets the filters before the next row.
  void restart() noexcept { filtered_ = 0; }

 private:
  /// One filter of the second order, for three coordinates.
  struct Filter {
    std::array<double, 3> b{}, a{};
    std::array<Vector3, 2> x{}, y{};
    Vector3 pass(const Vector3& in) noexcept;
  };
  Eigen::Vector3d axis_plate_;    ///< up the shaft
  std::array<Filter, 2> filter_;  ///< the high-pass, then the low-pass
  Vector3 origin_{};              ///< position of the tip in the first row after a reset
  // filtered_: number of rows since the last reset. settle_ticks_: number of rows that are left out
  // of the sums after a reset.
  std::uint64_t filtered_ = 0, settle_ticks_ = 0;
};

// Measures how far the tool's shaft comes out of the bone in which the tool is inserted. The result
// grades the final position of the tool.
//
// Definitions:
//  1. Bone is the material of the uncut sheets. The tool is a prism that begins at the tip and
//     extends upwards. The outline on a slice is the section of this prism with the plane of the
//     slice. Slices below the tip have no outline.
//  2. Each corner of an outline has a distance to the bone. If the corner is over material of its
//     own slice, the distance is 0. Otherwise it is the distance to the nearest material of any
//     slice, which is the smallest value of sqrt(d^2 + h^2) over all slices. d is the horizontal
//     distance from the corner to a slice's material, and h is the difference between the heights
//     of the corner and this slice.
//  3. The distance of an outline is the largest distance of its corners.
//  4. The bone begins at the first slice, counted from the top, at which the tool's axis is over
//     material. The entry is the upper part of the bone, where the tool comes in from outside. The
//     entry ends before the first slice whose outline has the distance 0. If no slice down to
//     kEntry_m below the beginning of the bone has this distance, the entry ends before the first
//     slice that is more than kEntry_m below the beginning. The entry is not judged. All slices
//     from the end of the entry down to the tip are judged. If no slice is judged, the tool is not
//     in bone and has no grade.
//  5. The violation is the largest distance of a judged outline, rounded to 1 nm. The grade is 0
//     for a violation of 0, 1 for less than 2 mm, 2 for 2 to 4 mm, and 3 for more than 4 mm.

inline constexpr double kEntry_m = 5e-3;  ///< largest height of the entry (definition 4)

struct WallViolation {
  double outside_m = 0;  ///< the violation
  /// Slice index of the outline with the largest distance. If several outlines have this distance,
  /// the topmost one counts. -1: the violation is 0.
  int slice = -1;
  int first_slice = 0;    ///< slice index of the topmost slice that is judged
  int slices_judged = 0;  ///< number of slices that are judged
};

/// Measures the violation. Returns none if the tool is not in bone (definition 4) or is tilted too
/// far (is_upright()). `sheets`: the uncut sheets, the topmost first. `tip_m`: the tool's tip in
/// {B}. `q`: orientation of the plate, w x y z.
std::optional<WallViolation> measure_wall_violation(std::span<const Sheet* const> sheets,
                                                    const Tool& tool,
                                                    const std::array<double, 3>& tip_m,
                                                    const std::array<double, 4>& q);

/// Returns the grade of a violation (definition 5).
int grade_of(double outside_m);
/// Returns the range of violations with this grade: "0", "under 2 mm", "2 to 4 mm" or "over 4 mm".
const char* words_of_grade(int grade);

// Collects the figures of a session tick by tick.

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
