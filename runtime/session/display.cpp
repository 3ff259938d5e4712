// SPDX-License-Identifier: Apache-2.0
#include "runtime/session/display.h"

#include <nlohmann/json.hpp>

#include "formats/base/file_io.h"
#include "runtime/session/responder.h"

namespace trocar::runtime {

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
    text_ += line.dump() + "\n";
    last_ = shape;
  }
  nlohmann::json frame = {{"t_s", row.t_s},      {"state", to_string(row.phase)},
                          {"tip_m", row.tool_m}, {"force_N", row.wrench_wanted[2]},
                          {"shape", nullptr},    {"depth_m", 0.0}};
  if (last_ != nullptr) {
    frame["shape"] = shapes_ - 1;
    frame["depth_m"] = shape_depth_m(row, *last_);
  }
  text_ += frame.dump() + "\n";
}

Result<void> FrameWriter::finish() const {
  return write_file_atomically(file_, text_);
}

}  // namespace trocar::runtime
