// SPDX-License-Identifier: GPL-3.0-or-later
// Finds the scanner's table, or a head holder, in the material of a scan in HU, so that it can be
// left out.
//
// A table is a rigid plate or shell along the scan with the same cross-section in every slice. A
// few slices are sampled on a grid of about 2.5 mm. The body is the region above -300 HU into
// which a disc of 10 mm fits. A table's cross-section is what lies beyond the body on one side
// and is at least 150 mm wide and at most 40 mm thick on average. Half of the samples must show
// such a cross-section on the same side, and nine in ten must have something at the same pixels.
// A connected component of the material is part of the table under two conditions: 80 % of it
// lies in that cross-section, and its surface borders on air, not on soft tissue as the surface
// of a bone does.
//
// No table is found in scans without a large body, in slices that are narrower than 150 mm or not
// axial, and where the material is not a threshold in HU. Then at most a few slices are read.
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "pipeline/read/slice_stack.h"
#include "pipeline/segment/segmentation.h"

namespace trocar::pipeline {

class ScannerTable {
 public:
  /// Searches the whole scan for a table, whichever slices are meshed. Slices that cannot be read
  /// are treated as empty, because meshing reports their errors. No value: there is no table in the
  /// material. O(voxels) if there is one; otherwise only samples are read.
  static std::optional<ScannerTable> find(const SliceStack& stack, const Segmentation& how);

  /// The table's voxels: runs of pixels within a row, in ascending order. The result is empty if
  /// the whole table is connected with other material.
  struct Run {
    std::size_t begin = 0, end = 0;  ///< (slice * height + y) * width + x
  };
  const std::vector<Run>& runs() const { return runs_; }

  /// Puts the pixels of the table in a slice's field below the iso-value (put_on_side()).
  /// (offset_x, offset_y) is the position of a cropped field in its slice.
  void remove(int slice, int offset_x, int offset_y, Field& field) const;

  /// `table_removed`, `table_connected` or both.
  const std::vector<Warning>& warnings() const { return warnings_; }

 private:
  std::size_t width_ = 0, height_ = 0;
  std::vector<Run> runs_;
  std::vector<Warning> warnings_;
};

}  // namespace trocar::pipeline
