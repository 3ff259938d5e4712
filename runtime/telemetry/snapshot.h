// SPDX-License-Identifier: Apache-2.0
// A snapshot holds numbers of the latest tick for other processes, in the columns of
// formats/session/telemetry.md. To add a value, add a line to the table in snapshot.cpp.
#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <span>
#include <utility>
#include <vector>

#include "formats/session/recording.h"
#include "formats/session/scene.h"
#include "formats/session/telemetry.h"
#include "runtime/contact/tool.h"
#include "runtime/device/hand_device.h"
#include "runtime/realtime/late_ticks.h"
#include "runtime/telemetry/telemetry_histogram.h"

namespace trocar::runtime {

/// Values of a tick that the haptic thread passes to the thread that writes snapshots. All counts
/// begin with 0 at the start of the session.
struct TelemetryTick {
  RecordingRow row;
  /// Start of the tick, on CLOCK_MONOTONIC. In a pause there are no ticks; then it is the time at
  /// which the loop last woke.
  std::int64_t taken_ns = 0;
  DeviceReadout readout;
  std::int32_t active_sheet = -1;  ///< index of a sheet (ContactOutput::active_sheet); -1: none
  std::uint64_t ticks = 0, missed_deadlines = 0, punctures = 0, faults = 0;
  std::uint64_t break_throughs = 0;
  LateTicks::Counts late_ticks{};  ///< missed deadlines that each part of the tick has caused
  std::int64_t late_max_ns = 0;    ///< longest delay of the haptic thread's wake-up so far
  std::uint64_t xray_shots = 0;
  double xray_screening_s = 0;
  /// Sheets that have been in contact, and sheets that have been punctured. Bit i: sheet i.
  std::uint64_t sheets_touched = 0, sheets_punctured = 0;
  std::array<std::uint32_t, kMaxSceneSlices> sheet_cuts{};  ///< number of holes in each sheet
  bool is_paused = false, has_ended = false;
};
static_assert(kMaxSceneSlices <= kMaxTelemetrySheets && kMaxSceneSlices <= 64);

/// The values from which the columns are computed. `tick_times`: durations of ticks. `wake_times`:
/// delays of the haptic thread's wake-ups. `last_event`: number of the last event written.
struct SnapshotSource {
  const TelemetryTick& tick;
  const Tool& tool;
  const TelemetryHistogram& tick_times;
  const TelemetryHistogram& wake_times;
  std::uint64_t last_event = 0;
  double recording_left_s = std::numeric_limits<double>::infinity();  ///< Recorder::left_s()
};

/// Returns the name of each column and its number of values, in the order of snapshot_values().
std::vector<std::pair<const char*, std::size_t>> snapshot_columns();
/// Returns the total number of values in all columns.
std::size_t snapshot_size();
/// Fills `values`, which must have the size snapshot_size().
void snapshot_values(const SnapshotSource& source, std::span<double> values);

}  // namespace trocar::runtime
