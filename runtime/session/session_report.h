// SPDX-License-Identifier: Apache-2.0
// The figures of a session for the talk with the trainee afterwards (`trocar-run
// --session-report`): a function of its ticks, its scene and the heights of its sheets, so that a
// replay gives the same. Memory is bounded however long the session is.
//
// What each figure is (formats/session/session_report.schema.json says the same of its fields):
//  1. Rows of the safety states `ready` and `running` count; in others the pose may be an old one.
//     Times are numbers of rows over the rate. The force is the length of the delivered one.
//  2. Insertion: from the first row in contact to the row with the lowest tip after it.
//     Straightness is the distance between the two over the way of the tip.
//  3. A puncture's force is that of the row before it, its depth that of the tip below the sheet as
//     it was placed, or below the layer's top.
//  4. A break-through is a puncture (of several in a row the lowest) at which the wanted force
//  falls
//     to at most half of that of the row before. Its plunge is how far the tip goes on down from
//     there until it has come back by kPlungeStep_m (reversed), has advanced by less than
//     kPlungeStep_m in kPlungeStop_s (stopped), kPlunge_s have passed (time), the next
//     break-through comes (next), or rows no longer count (fault, end).
//  5. Tremor: the tip's place minus that of the first row, through a high-pass of kTremorLow_Hz and
//     a low-pass of kTremorHigh_Hz, each y = (b0 x + b1 x1 + b2 x2 - a1 y1 - a2 y2) / a0 with
//     w = 2 pi f / rate, alpha = sin w / sqrt 2, a0 = 1 + alpha, a1 = -2 cos w, a2 = 1 - alpha,
//     b0 = b2 = (1 + cos w) / 2, b1 = -(1 + cos w) of the high-pass and b0 = b2 = (1 - cos w) / 2,
//     b1 = 1 - cos w of the low-pass (Butterworth of the second order). RMS of its length, and of
//     its part in x and y, over the rows that are free, and over those in contact; without the
//     first kTremorSettle_s of rows that count one after the other, where the filters start anew.
//  6. Distance to the planned line: of rows in which the tip is beyond the entry point along the
//     line. To a zone: of the tip's point, negative inside; a breach is rows below 0 in a row.
//  7. Beside: rows in which the tool is below a slice beside its material, in a row.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "formats/session/scene.h"
#include "runtime/session/session.h"
#include "runtime/session/tick_feed.h"

namespace trocar::runtime {

inline constexpr double kPlunge_s = 0.5, kPlungeStop_s = 0.05, kPlungeStep_m = 5e-5;
inline constexpr double kTremorLow_Hz = 4, kTremorHigh_Hz = 12, kTremorSettle_s = 0.5;
inline constexpr std::size_t kReportPunctures = 1024;  ///< that are listed
inline constexpr std::size_t kReportSpans = 64;        ///< breaches of a zone, ways beside, faults
inline constexpr std::size_t kReportSamples = 1024;

/// A sheet, the topmost first, and where its material is in the picture.
struct ReportSheet {
  int slice = 0;
  double z_m = 0;
  std::string tissue;  ///< empty: it has no name
};

/// What was punctured: a sheet, or a soft layer.
struct Punctured {
  bool is_layer = false;
  std::size_t index = 0;  ///< of the sheet, the topmost is 0; or of Scene::layers
};
struct ReportPuncture {
  Punctured what;
  double t_s = 0, force_N = 0, depth_m = 0, tip_z_m = 0;
};
enum class PlungeEnd : std::uint8_t { kReversed, kStopped, kTime, kNext, kFault, kEnd };
struct BreakThrough {
  Punctured what;
  double t_s = 0, plunge_m = 0;
  double below_m = 0;  ///< of the lowest tip, below the sheet or the layer's bottom
  double lowest_t_s = 0, ended_t_s = 0;
  PlungeEnd ended_by = PlungeEnd::kEnd;
};
struct Tremor {
  std::uint64_t ticks = 0;
  double squares_m2 = 0, sideways_m2 = 0;  ///< sums
};
/// From the first to the last row of it.
struct Span {
  int slice = -1;  ///< of ways beside
  double from_s = 0, to_s = 0;
  double depth_m = 0, depth_t_s = 0;  ///< of breaches
};
struct ZoneFigures {
  std::optional<double> min_m;
  double min_t_s = 0;
  std::vector<Span> breaches;  ///< the first kReportSpans
  std::uint64_t breaches_count = 0;
};
struct ReportFault {
  Fault fault = Fault::kNone;
  double t_s = 0;
  std::optional<double> recovered_s;
};
struct GoalResult {
  std::string goal, zone;  ///< zone: empty but of a zone
  double limit = 0;
  bool at_least = false;  ///< the limit is the least value; else the largest
  std::optional<double> value;
  const char* unit = "m";
  bool met = false;
  std::string how;
};
/// The row with the largest force of `stride` rows.
struct ReportSample {
  double t_s = 0;
  std::array<double, 3> tip_m{};
  double force_N = 0;
};

struct SessionFigures {
  double rate_Hz = 0;
  std::uint64_t ticks = 0, counted = 0, free = 0, contact = 0, through = 0;
  double top_z_m = 0;  ///< of the highest sheet or layer: depths count from there
  double length_m = 0;
  std::optional<double> insertion_m, straight_m;  ///< way and distance
  double lowest_z_m = 0;
  std::array<double, 3> lowest_m{};  ///< the tip there
  std::optional<double> first_contact_s, last_puncture_s;
  double force_max_N = 0, force_max_t_s = 0, contact_sum_N = 0;
  std::array<double, 3> force_max_tip_m{};
  std::vector<ReportPuncture> punctures;  ///< the first kReportPunctures
  std::uint64_t punctures_count = 0;
  std::vector<BreakThrough> break_throughs;  ///< likewise
  std::uint64_t break_throughs_count = 0;
  double plunge_max_m = 0;
  Tremor tremor_free, tremor_contact;
  std::uint64_t line_ticks = 0;
  double line_max_m = 0, line_squares_m2 = 0, line_entry_m = 0;
  std::optional<double> target_m, target_reached_s;
  double target_t_s = 0;
  std::vector<ZoneFigures> zones;  ///< as SceneGoals::zones
  std::vector<Span> beside;        ///< the first kReportSpans
  std::uint64_t beside_count = 0, beside_ticks = 0;
  std::vector<Span> side_cuts;  ///< slice and from_s; the first kReportSpans
  std::uint64_t side_cuts_count = 0;
  std::vector<ReportFault> faults;  ///< the first kReportSpans
  std::uint64_t faults_count = 0;
  std::vector<ReportSample> samples;
  std::uint64_t stride = 1;
  std::vector<GoalResult> goals;  ///< in the order of SceneGoals
};

/// One of the two filters of the tremor, for three coordinates.
struct TremorFilter {
  using Place = std::array<double, 3>;
  std::array<double, 3> b{}, a{};
  std::array<Place, 2> x{}, y{};
  Place pass(const Place& in) noexcept;
};

/// Sees a session tick by tick.
class SessionObserver {
 public:
  /// `scene` must outlive this.
  SessionObserver(const Scene& scene, std::vector<ReportSheet> sheets, double rate_Hz);
  void see(const SeenTick& tick);
  /// After the last tick.
  SessionFigures figures();

 private:
  using Place = std::array<double, 3>;
  void see_gap(const RecordingRow& row);
  void see_path(const RecordingRow& row);
  void see_punctures(const SeenTick& tick);
  void add_puncture(const Punctured& what, const RecordingRow& row);
  void see_plunge(const RecordingRow& row);
  void end_plunge(PlungeEnd end, double t_s);
  void see_tremor(const RecordingRow& row);
  void see_goals(const RecordingRow& row);
  void see_beside(const RecordingRow& row);
  void see_fault(const RecordingRow& row);
  void sample(const RecordingRow& row, double force_N);
  void judge_goals();
  double height_of(const Punctured& what) const;

  const Scene& scene_;
  std::vector<ReportSheet> sheets_;
  SessionFigures out_;
  double last_force_N_ = 0, last_wanted_N_ = 0, last_t_s_ = 0;
  std::optional<Place> last_tip_;
  Place contact_tip_{};
  double way_m_ = 0;  ///< since the first contact
  double lowest_inserted_m_ = 0;
  // The break-through that is watched:
  std::optional<BreakThrough> open_;
  double plunge_from_m_ = 0, plunge_lowest_m_ = 0;
  std::vector<double> recent_m_;  ///< heights of the tip since the break-through, a ring
  std::uint64_t plunge_ticks_ = 0, plunge_stop_ = 1, plunge_end_ = 1;
  std::array<TremorFilter, 2> filter_;  ///< high-pass, low-pass
  Place filter_zero_{};
  std::uint64_t filtered_ = 0, settle_ = 0;
  std::vector<bool> in_zone_;
  bool is_beside_ = false;
  std::int32_t beside_slice_ = -1;
  Fault last_fault_ = Fault::kNone;
  std::uint64_t in_sample_ = 0;
};

/// Distance of a point to a zone, negative inside (m).
double zone_distance_m(const ForbiddenZone& zone, const std::array<double, 3>& p_m);

/// What else the page says.
struct ReportFacts {
  std::string asset;      ///< its name
  std::string force_law;  ///< by its name
  bool is_virtual = false;
  SessionEnd end = SessionEnd::kDone;
  std::uint64_t lost_ticks = 0;
  std::vector<FaultEvent> faults;  ///< for what was measured
  std::vector<ReportSheet> sheets;
  /// Where each sheet had material, along x and along y through the lowest place of the tip, for
  /// the pictures: intervals, m.
  std::array<std::vector<std::vector<std::array<double, 2>>>, 2> material_m;
};

/// The intervals of one line on a sheet (`axis` 0: along x at y = at_m; 1: along y at x = at_m)
/// that are over its material, ascending.
std::vector<std::array<double, 2>> material_along(const Sheet& sheet, int axis, double at_m);

/// formats/session/session_report.schema.json; without a line feed at its end.
std::string session_report_json(const Scene& scene, const SessionFigures& figures,
                                const ReportFacts& facts);
/// One HTML page without scripts and without anything from outside.
std::string session_report_page(const Scene& scene, const SessionFigures& figures,
                                const ReportFacts& facts);

/// A fault's line for the report: what was measured where that is known.
std::string fault_message(const ReportFault& fault, const ReportFacts& facts);

}  // namespace trocar::runtime
