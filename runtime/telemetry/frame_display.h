// SPDX-License-Identifier: Apache-2.0
// Supplies frames to a display at the display's frame rate. A frame consists of the latest row and
// the shape, which is the deformed sheet around the tool. Only the force law `network` has a shape.
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

/// Receives a frame: the latest row, and the shape or null.
using FrameFunction =
    std::function<void(const RecordingRow&, const std::shared_ptr<const SheetShape>&)>;

/// Calls a function with each frame, but never on the realtime haptic thread. In real time, the
/// wall clock determines when a frame is due; in virtual time, the number of ticks determines it.
class FrameDisplay final : public TickObserver {
 public:
  /// `show`: the function to call. `prefetch`: the worker that supplies the shape; may be null.
  /// `tick_rate_Hz`: rate of the ticks in virtual time; 0: real time.
  FrameDisplay(FrameFunction show, double frame_rate_Hz, double tick_rate_Hz,
               const PrefetchWorker* prefetch);
  ~FrameDisplay() override { stop(); }

  void on_tick(const TickView& tick) noexcept override;
  void serve() override;
  /// Ends the thread. Unlike TickObserver::stop(), this function does not call serve() once more.
  void stop() override { join(); }

 private:
  FrameFunction show_;
  double frame_rate_Hz_, tick_rate_Hz_;
  const PrefetchWorker* prefetch_;
  std::uint64_t frames_ = 0;  ///< number of frames so far in virtual time
  TripleBuffer<RecordingRow> latest_;
};

/// Returns how deep the tool presses the sheet to which the shape belongs, in the tick of this row:
/// the penetration if the tool is in contact with this sheet, otherwise 0.
double shape_depth_m(const RecordingRow& row, const SheetShape& shape) noexcept;

/// Writes frames as JSON lines. For each new shape there is a line
///   {"shape", "slice", "z_m", "cuts", "vertices_m": [[x, y], ...], "triangles", "w"},
/// and for each frame a line
///   {"t_s", "state", "tip_m", "wanted_z_N", "shape", "depth_m"}.
/// Shapes are numbered from 0. In the line of a shape, "cuts" is the number of holes in the sheet,
/// and "w" says how far each vertex follows the tool: w is 1 at the tool's outline and falls to 0
/// away from it. In a frame, "state" is the phase of contact, "wanted_z_N" is the z component of the
/// wanted force, and "shape" is the number of the latest shape, or null if there is none yet.
/// Vertex i of the latest shape is at the height z_m - depth_m w[i].
class FrameWriter {
 public:
  explicit FrameWriter(std::filesystem::path file) : file_(std::move(file)) {}

  /// Adds a frame. `shape` may be null.
  void add(const RecordingRow& row, const std::shared_ptr<const SheetShape>& shape);
  /// Writes all lines to the file, atomically.
  Result<void> finish() const;

 private:
  std::filesystem::path file_;
  std::string text_;
  std::shared_ptr<const SheetShape> last_;
  int shapes_ = 0;
};

}  // namespace trocar::runtime
