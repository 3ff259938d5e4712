// SPDX-License-Identifier: Apache-2.0
// Data of one display frame, at frame rate and outside the haptic thread: the sheet around the tool
// and its depth.
#pragma once

#include <filesystem>
#include <memory>
#include <string>

#include "formats/base/result.h"
#include "formats/session/recording.h"

namespace trocar::runtime {

struct SheetShape;  // runtime/session/responder.h

/// Depth to which the tool presses the shape's sheet in this tick: the penetration in contact, else
/// 0 (the sheet is at rest).
double shape_depth_m(const RecordingRow& row, const SheetShape& shape) noexcept;

/// Frames as JSON lines: a line for each new shape,
///   {"shape", "slice", "z_m", "cuts", "vertices_m": [[x, y], ...], "triangles", "w"},
/// and a line for each frame, {"t_s", "state", "tip_m", "force_N", "shape", "depth_m"}, whose
/// "shape" is the number of the last shape line, or null before the first.
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
