// SPDX-License-Identifier: Apache-2.0
// What a picture of the session needs, at frame rate and off the haptic thread: the sheet around
// the tool and how deep it is pushed.
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "formats/session/recording.h"
#include "formats/base/result.h"

namespace trocar::runtime {

struct SheetShape;  // runtime/session/responder.h

/// How deep the tool holds the shape's sheet in this tick: its penetration in contact, else 0 (the
/// sheet has sprung back, or is not reached yet).
double shape_depth_m(const RecordingRow& row, const SheetShape& shape) noexcept;

/// Heights of the shape's vertices in {B}.
std::vector<double> displaced_heights_m(const SheetShape& shape, double depth_m);

/// Frames as JSON lines: a line for each new shape,
///   {"shape", "slice", "z_m", "cuts", "vertices_m": [[x, y], ...], "triangles", "w"},
/// and one for each frame, {"t_s", "state", "tip_m", "force_N", "shape", "depth_m"}, whose "shape"
/// is the number of the last shape line, or null before the first.
class FrameWriter {
 public:
  explicit FrameWriter(std::filesystem::path file) : file_(std::move(file)) {}

  /// `shape` may be null.
  void add(const RecordingRow& row, const std::shared_ptr<const SheetShape>& shape);
  /// Writes the file, whole or not at all.
  Result<void> finish() const;

 private:
  std::filesystem::path file_;
  std::string text_;
  std::shared_ptr<const SheetShape> last_;
  int shapes_ = 0;
};

}  // namespace trocar::runtime
