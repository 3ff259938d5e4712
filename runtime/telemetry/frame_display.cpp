// SPDX-License-Identifier: Apache-2.0
#include "runtime/telemetry/frame_display.h"

#include <nlohmann/json.hpp>
#include <utility>

#include "formats/base/file_io.h"
#include "formats/base/json_text.h"

namespace trocar::runtime {

FrameDisplay::FrameDisplay(FrameFunction show, double frame_rate_Hz, double tick_rate_Hz,
                           const PrefetchWorker* prefetch)
    : TickObserver(std::chrono::nanoseconds(static_cast<std::int64_t>(1e9 / frame_rate_Hz))),
      show_(std::move(show)),
      frame_rate_Hz_(frame_rate_Hz),
      tick_rate_Hz_(tick_rate_Hz),
      prefetch_(prefetch) {}

void FrameDisplay::on_tick(const TickView& tick) noexcept {
  if (tick_rate_Hz_ > 0) {
    const double now_s = static_cast<double>(tick.state.tick - 1) / tick_rate_Hz_;
    if (now_s * frame_rate_Hz_ < static_cast<double>(frames_)) return;
    ++frames_;
  }
  latest_.write(tick.result.row);
}

void FrameDisplay::serve() {
  RecordingRow row;
  if (latest_.read(row)) show_(row, prefetch_ == nullptr ? nullptr : prefetch_->shape());
}

double shape_depth_m(const RecordingRow& row, const SheetShape& shape) noexcept {
  const bool held = row.phase == ContactPhase::kContact && row.active_slice == shape.slice_index;
  return held ? row.penetration_m : 0;
}

void FrameWriter::add(const RecordingRow& row, const std::shared_ptr<const SheetShape>& shape) {
  if (shape != nullptr && shape != last_) {
    const nlohmann::json line = {
        {"shape", shapes_++},  {"slice", shape->slice_index},     {"z_m", shape->z_m},
        {"cuts", shape->cuts}, {"vertices_m", shape->vertices_m}, {"triangles", shape->triangles},
        {"w", shape->w}};
    text_ += json_text(line) + "\n";
    last_ = shape;
  }
  nlohmann::json frame = {{"t_s", row.t_s},      {"state", to_string(row.phase)},
                          {"tip_m", row.tool_m}, {"wanted_z_N", row.wrench_wanted[2]},
                          {"shape", nullptr},    {"depth_m", 0.0}};
  if (last_ != nullptr) {
    frame["shape"] = shapes_ - 1;
    frame["depth_m"] = shape_depth_m(row, *last_);
  }
  text_ += json_text(frame) + "\n";
}

Result<void> FrameWriter::finish() const {
  return write_file_atomically(file_, text_);
}

}  // namespace trocar::runtime
