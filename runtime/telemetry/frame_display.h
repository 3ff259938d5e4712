// SPDX-License-Identifier: Apache-2.0
// Supplies frames to a display, at frame rate and not on the haptic thread. A frame consists of the
// latest row, the sheet around the tool, and the tool's depth in this sheet.
// Tests: tests/runtime/session/network_session_test.cpp
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>

#include "formats/base/result.h"
#include "formats/session/recording.h"
#include "runtime/contact/prefetch_worker.h"
#include "runtime/realtime/triple_buffer.h"
#include "runtime/telemetry/tick_observer.h"

namespace trocar::runtime {

/// Receives the latest row and the deformed sheet around the tool, called shape here. The shape is
/// null except with the force law `network`.
using FrameFunction =
    std::function<void(const RecordingRow&, const std::shared_ptr<const SheetShape>&)>;

/// Calls a function at the frame rate, measured on the wall clock or, in virtual time, in ticks.
class FrameDisplay final : public TickObserver {
 public:
  /// `prefetch`: the worker from which the shape comes; may be null. `tick_rate_Hz`: rate of the
  /// ticks in virtual time; 0: real time.
  FrameDisplay(FrameFunction show, double frame_rate_Hz, double tick_rate_Hz,
               const PrefetchWorker* prefetch);
  ~FrameDisplay() override { stop(); }

  void on_tick(const TickView& tick) noexcept override;
  void serve() override;
  /// Ends the thread; unlike TickObserver::stop(), shows no last frame.
  void stop() override { join(); }

 private:
  FrameFunction show_;
  double frame_rate_Hz_, tick_rate_Hz_;
  const PrefetchWorker* prefetch_;
  std::uint64_t frames_ = 0;  ///< number of frames so far in virtual time
  TripleBuffer<RecordingRow> latest_;
};

/// Returns the depth to which the tool presses the shape's sheet in this tick. If the tool is in
/// contact with this sheet, the depth is the penetration. Otherwise the sheet is not deformed, and
/// the depth is 0.
double shape_depth_m(const RecordingRow& row, const SheetShape& shape) noexcept;

/// Writes frames as JSON lines. For each new shape there is a line
///   {"shape", "slice", "z_m", "cuts", "vertices_m": [[x, y], ...], "triangles", "w"},
/// and for each frame a line
///   {"t_s", "state", "tip_m", "force_N", "shape", "depth_m"}.
/// In a frame, "force_N" is the wanted force along z, and "shape" is the number of the latest
/// shape, or null if there is none yet. A vertex of that shape is at the height z_m - depth_m w.
class FrameWriter {
 public:
  explicit FrameWriter(std::filesystem::path file) : file_(std::move(file)) {}

  /// `shape` may be null.
  void add(const RecordingRow& row, const std::shared_ptr<const SheetShape>& shape);
  /// Writes the file atomically.
  Result<void> finish() const;

 private:
  std::filesystem::path file_;
  std::string text_;
  std::shared_ptr<const SheetShape> last_;
  int shapes_ = 0;
};

}  // namespace trocar::runtime
