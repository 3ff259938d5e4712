// SPDX-License-Identifier: Apache-2.0
#include "runtime/telemetry/snapshot.h"

#include <algorithm>

namespace trocar::runtime {
namespace {

struct Column {
  const char* name;
  std::size_t count;
  void (*fill)(const SnapshotSource& source, double* values);
};

template <typename Get>
constexpr Column one(const char* name, Get) {
  return {name, 1,
          [](const SnapshotSource& s, double* values) { *values = static_cast<double>(Get{}(s)); }};
}

/// Makes a column of `count` numbers. `Get` returns an array or another range.
template <typename Get>
constexpr Column many(const char* name, std::size_t count, Get) {
  return {name, count, [](const SnapshotSource& s, double* values) {
            for (const auto value : Get{}(s))
              *values++ = static_cast<double>(value);
          }};
}

Eigen::Vector3d axis_of(const SnapshotSource& s) {
  const std::array<double, 4>& q = s.tick.row.q;
  return Eigen::Quaterniond(q[0], q[1], q[2], q[3]) * -s.tool.axis_plate;
}

std::array<double, kMaxSceneSlices> bits_of(std::uint64_t bits) {
  std::array<double, kMaxSceneSlices> values;
  for (unsigned i = 0; i < kMaxSceneSlices; ++i)
    values[i] = static_cast<double>(bits >> i & 1U);
  return values;
}

std::array<double, TelemetryHistogram::kBins> counts_of(const TelemetryHistogram& histogram) {
  std::array<double, TelemetryHistogram::kBins> counts;
  for (std::size_t i = 0; i < counts.size(); ++i)
    counts[i] = static_cast<double>(histogram.count(i));
  return counts;
}

using S = SnapshotSource;
constexpr Column kColumns[] = {
    one("t_s", [](const S& s) { return s.tick.row.t_s; }),
    one("taken_at_s", [](const S& s) { return static_cast<double>(s.tick.taken_ns) * 1e-9; }),
    many("p_m", 3, [](const S& s) { return s.tick.row.p_m; }),
    many("q", 4, [](const S& s) { return s.tick.row.q; }),
    many("tool_m", 3, [](const S& s) { return s.tick.row.tool_m; }),
    many("axis", 3, [](const S& s) { return axis_of(s); }),
    many("wrench_wanted", 6, [](const S& s) { return s.tick.row.wrench_wanted; }),
    many("wrench_delivered", 6, [](const S& s) { return s.tick.row.wrench_delivered; }),
    many("tau_Nm", kMaxCommanded, [](const S& s) { return s.tick.row.tau_Nm; }),
    many("tau_limit_Nm", kMaxCommanded, [](const S& s) { return s.tick.readout.command_limit; }),
    many("motor_angle_rad", kMaxMeasured, [](const S& s) { return s.tick.row.encoder_rad; }),
    one("joint_margin", [](const S& s) { return s.tick.readout.margin; }),
    one("phase", [](const S& s) { return s.tick.row.phase; }),
    one("active_slice", [](const S& s) { return s.tick.row.active_slice; }),
    one("active_sheet", [](const S& s) { return s.tick.active_sheet; }),
    one("penetration_m", [](const S& s) { return s.tick.row.penetration_m; }),
    one("wrench_scale", [](const S& s) { return s.tick.row.wrench_scale; }),
    one("pose_residual_m", [](const S& s) { return s.tick.row.pose_residual_m; }),
    one("cuts_published", [](const S& s) { return s.tick.row.cuts_published; }),
    one("fault", [](const S& s) { return s.tick.row.fault; }),
    one("safety", [](const S& s) { return s.tick.row.safety; }),
    one("authority", [](const S& s) { return s.tick.row.authority; }),
    one("passivity_J", [](const S& s) { return s.tick.row.passivity_J; }),
    one("motor_heat_max", [](const S& s) { return s.tick.row.motor_heat_max; }),
    one("ticks", [](const S& s) { return s.tick.ticks; }),
    one("missed_deadlines", [](const S& s) { return s.tick.missed_deadlines; }),
    many("missed_by", kTickParts, [](const S& s) { return s.tick.late_ticks; }),
    one("late_max_us", [](const S& s) { return static_cast<double>(s.tick.late_max_ns) * 1e-3; }),
    one("front_z_m", [](const S& s) { return s.tick.row.cutting.front_z_m; }),
    one("front_HU", [](const S& s) { return s.tick.row.cutting.front_HU; }),
    one("tip_N", [](const S& s) { return s.tick.row.tip_N; }),
    one("embedded_m", [](const S& s) { return s.tick.row.cutting.embedded_m; }),
    one("cut_J", [](const S& s) { return s.tick.row.cutting.cut_J; }),
    one("absorbed_J", [](const S& s) { return s.tick.row.cutting.absorbed_J; }),
    one("stored_J", [](const S& s) { return s.tick.row.cutting.stored_J; }),
    one("punctures", [](const S& s) { return s.tick.punctures; }),
    one("break_throughs", [](const S& s) { return s.tick.break_throughs; }),
    one("faults", [](const S& s) { return s.tick.faults; }),
    one("events", [](const S& s) { return s.last_event; }),
    one("xray_shots", [](const S& s) { return s.tick.xray_shots; }),
    one("xray_screening_s", [](const S& s) { return s.tick.xray_screening_s; }),
    one("recording_left_s", [](const S& s) { return s.recording_left_s; }),
    one("paused", [](const S& s) { return s.tick.is_paused; }),
    one("ended", [](const S& s) { return s.tick.has_ended; }),
    many("tick_us", TelemetryHistogram::kBins, [](const S& s) { return counts_of(s.tick_times); }),
    many("wake_us", TelemetryHistogram::kBins, [](const S& s) { return counts_of(s.wake_times); }),
    many("sheet_cuts", kMaxSceneSlices, [](const S& s) { return s.tick.sheet_cuts; }),
    many("sheet_touched", kMaxSceneSlices,
         [](const S& s) { return bits_of(s.tick.sheets_touched); }),
    many("sheet_punctured", kMaxSceneSlices,
         [](const S& s) { return bits_of(s.tick.sheets_punctured); }),
};

}  // namespace

std::vector<std::pair<const char*, std::size_t>> snapshot_columns() {
  std::vector<std::pair<const char*, std::size_t>> columns;
  for (const Column& column : kColumns)
    columns.emplace_back(column.name, column.count);
  return columns;
}

std::size_t snapshot_size() {
  std::size_t size = 0;
  for (const Column& column : kColumns)
    size += column.count;
  return size;
}

void snapshot_values(const SnapshotSource& source, std::span<double> values) {
  std::size_t next = 0;
  for (const Column& column : kColumns) {
    column.fill(source, values.subspan(next, column.count).data());
    next += column.count;
  }
}

}  // namespace trocar::runtime
