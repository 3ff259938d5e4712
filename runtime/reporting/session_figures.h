// SPDX-License-Identifier: Apache-2.0
// The figures of a session for the debriefing (`trocar-run --session-report`). They depend only on
// the session's ticks, its scene and the heights of its sheets, so a replay gives the same figures.
// Their memory is bounded, however long the session is.
//
// Definitions (formats/session/session_report.schema.json repeats them for its fields):
//  1. Counted rows are those of the safety states `ready` and `running`; in other states the pose
//     may be an old one. A time is a number of rows divided by the rate. The force is the magnitude
//     of the delivered force.
//  2. The insertion begins with the first row in contact, and ends with the row after it that has
//     the lowest tip. Straightness is the distance between these two positions of the tip, divided
//     by the length of the tip's path between them.
//  3. A puncture's force is the force of the row before it. Its depth is the depth of the tip below
//     the undeformed sheet, or below the layer's top.
//  4. A break-through is a puncture at which the wanted force falls to at most half of that of the
//     row before. If one row has several punctures, the lowest counts. The plunge is the distance by
//     which the tip moves down from the row before until one of these events: the tip has come back
//     by kPlungeStep_m (reversed), it has advanced by less than kPlungeStep_m in kPlungeStop_s
//     (stopped), kPlunge_s have passed (time), the next break-through happens (next), a row is not
//     counted (fault), or the session ends (end). It is the sum of two parts between the same rows:
//     the motion of the hand is that of a tool fixed to the plate, and the release is the remainder,
//     by which the coupling of plate and tool relaxes (0 without a coupling).
//  5. Tremor is measured with two Butterworth filters of the second order, a high-pass of
//     kTremorLow_Hz and a low-pass of kTremorHigh_Hz. Their input is the position of the tip minus
//     its position in the first row:
//       y = (b0 x + b1 x1 + b2 x2 - a1 y1 - a2 y2) / a0, w = 2 pi f / rate, alpha = sin w / sqrt 2,
//       a0 = 1 + alpha, a1 = -2 cos w, a2 = 1 - alpha;
//       high-pass: b0 = b2 = (1 + cos w) / 2, b1 = -(1 + cos w);
//       low-pass: b0 = b2 = (1 - cos w) / 2, b1 = 1 - cos w.
//     The figures are the RMS of the length of the filters' output, and of its part in x and y, over
//     the free rows and over the rows in contact. After each row that is not counted the filters are
//     reset. The first kTremorSettle_s after a reset are left out.
//  6. The distance to the planned line is measured in rows in which the tip is beyond the entry
//     point along the line. The distance of the tip to a zone is negative inside the zone. A breach
//     is a run of rows with a negative distance.
//  7. A miss is a run of rows in which the tool is below a slice, past the edge of its material.
//  8. The tip is in bone in counted rows in contact or punctured that have an active slice. An
//     attempt begins with the first such row, and with each such row after the tip has left the bone,
//     unless the tip is higher than in the counted row directly before: it then comes back through the
//     bone from below. The tip has left the bone when, in a counted row that is not in bone, it is at least kLeave_m
//     away from where it was in the last row in bone. A re-entry is an attempt after the first.
//  9. The force-time integral is the sum of the force over the counted rows, divided by the rate.
// 10. The final position is the counted row with the lowest tip, the first of several.
//     wall_violation.h defines how far the tool is outside bone there.
// 11. The HU beside a force is front_HU of the same row (force law `cutting` only).
// Tests: tests/e2e/session_report_test.py
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "formats/session/recording.h"

namespace trocar::runtime {

inline constexpr double kPlunge_s = 0.5, kPlungeStop_s = 0.05, kPlungeStep_m = 5e-5;
inline constexpr double kTremorLow_Hz = 4, kTremorHigh_Hz = 12, kTremorSettle_s = 0.5;
inline constexpr double kLeave_m = 1e-3;
inline constexpr std::size_t kMaxReportPunctures = 1024;
inline constexpr std::size_t kMaxReportSpans =
    64;  ///< largest number of breaches of a zone, of misses, side cuts, attempts and faults
inline constexpr std::size_t kMaxReportSamples = 1024;

/// A sheet of the scene. Lists of sheets begin with the topmost one.
struct ReportSheet {
  int slice = 0;
  double z_m = 0;
  std::string tissue;  ///< empty: the tissue has no name
};

/// A sheet, or a soft layer, that was punctured.
struct Punctured {
  bool is_layer = false;
  std::size_t index = 0;  ///< index into Scene::layers, or into the sheets
};
struct ReportPuncture {
  Punctured what;
  double t_s = 0, force_N = 0, tip_N = 0, depth_m = 0, tip_z_m = 0;
  std::optional<double> front_HU;
};
enum class PlungeEnd : std::uint8_t { kReversed, kStopped, kTime, kNext, kFault, kEnd };
struct BreakThrough {
  Punctured what;
  double t_s = 0, plunge_m = 0;
  double hand_m = 0;   ///< the part of the plunge that the hand moved
  double below_m = 0;  ///< depth of the lowest tip below the sheet, or below the layer's bottom
  double lowest_t_s = 0, ended_t_s = 0;
  PlungeEnd ended_by = PlungeEnd::kEnd;
};
struct Tremor {
  std::uint64_t ticks = 0;
  double squares_m2 = 0, sideways_m2 = 0;  ///< sums of squares over the ticks
};
/// A run of rows, from its first to its last row.
struct Span {
  int slice = -1;  ///< slice index of a miss or a side cut; -1: none
  double from_s = 0, to_s = 0;
  double depth_m = 0, depth_t_s = 0;  ///< largest depth of a breach, and its time
};
struct ZoneFigures {
  std::optional<double> min_m;
  double min_t_s = 0;
  std::vector<Span> breaches;  ///< the first kMaxReportSpans breaches
  std::uint64_t breaches_count = 0;
};
struct ReportFault {
  Fault fault = Fault::kNone;
  double t_s = 0;
  std::optional<double> recovered_s;
};
struct GoalResult {
  std::string goal;
  std::string zone;  ///< name of the zone, if the goal belongs to a zone
  double limit = 0;
  bool at_least = false;  ///< true: the value must reach the limit; false: it must not exceed it
  std::optional<double> value;
  const char* unit = "m";
  bool met = false;
  std::string how;
};
/// The row with the largest force among SessionFigures::stride rows.
struct ReportSample {
  double t_s = 0;
  std::array<double, 3> tip_m{};
  double force_N = 0;
  std::optional<double> front_HU;
};

struct SessionFigures {
  double rate_Hz = 0;
  std::uint64_t ticks = 0, counted = 0, free = 0, contact = 0, through = 0;
  double top_z_m = 0;  ///< height of the highest sheet or layer, from which depths are measured
  double length_m = 0;
  std::optional<double> insertion_m, straight_m;  ///< path length and distance
  double lowest_z_m = 0;
  std::array<double, 3> lowest_m{};            ///< position of the lowest tip
  std::array<double, 4> lowest_q{1, 0, 0, 0};  ///< orientation of the plate then, w x y z
  double lowest_t_s = 0;
  std::vector<Span>
      attempts;  ///< the first kMaxReportSpans, each from its first to its last row in bone
  std::uint64_t attempts_count = 0;
  std::optional<double> first_contact_s, last_puncture_s;
  double force_max_N = 0, force_max_t_s = 0, contact_sum_N = 0, counted_sum_N = 0;
  std::array<double, 3> force_max_tip_m{};
  std::vector<ReportPuncture> punctures;  ///< the first kMaxReportPunctures
  std::uint64_t punctures_count = 0;
  std::vector<BreakThrough> break_throughs;  ///< the first kMaxReportPunctures
  std::uint64_t break_throughs_count = 0;
  double plunge_max_m = 0;
  Tremor tremor_free, tremor_contact;
  std::uint64_t line_ticks = 0;
  double line_max_m = 0, line_squares_m2 = 0, line_entry_m = 0;
  std::optional<double> target_m, target_reached_s;
  double target_t_s = 0;
  std::vector<ZoneFigures> zones;  ///< in the order of SceneGoals::zones
  std::vector<Span> misses;        ///< the first kMaxReportSpans
  std::uint64_t misses_count = 0, missed_ticks = 0;
  std::vector<Span> side_cuts;  ///< slice and from_s; the first kMaxReportSpans
  std::uint64_t side_cuts_count = 0;
  std::vector<ReportFault> faults;  ///< the first kMaxReportSpans
  std::uint64_t faults_count = 0;
  std::uint64_t operator_stops_count = 0;  ///< pauses, and times with the forces switched off
  std::vector<ReportSample> samples;
  std::uint64_t stride = 1;
  std::vector<GoalResult> goals;  ///< in the order of SceneGoals
};

/// Returns the number of ticks of a duration, at least 1.
inline std::uint64_t ticks_of(double duration_s, double rate_Hz) {
  return static_cast<std::uint64_t>(std::max(1.0, std::round(duration_s * rate_Hz)));
}

/// Increases `count`. Appends `value` if the list is shorter than `max`.
template <typename T>
void keep(std::vector<T>& list, std::size_t max, std::uint64_t& count, T value) {
  ++count;
  if (list.size() < max) list.push_back(std::move(value));
}

}  // namespace trocar::runtime
