// SPDX-License-Identifier: GPL-3.0-or-later
// Finds the scanner's table, or a head holder, in the material of a scan in HU. The table can then
// be left out.
//
// A table is a rigid plate or shell along the scan with the same cross-section in every slice. Up
// to ten slices are sampled on a grid of about 2.5 mm. In a sampled slice, the body is the region
// above -300 HU into which a disc of radius 10 mm fits. The table's cross-section is whatever lies
// beyond the body on one side, provided that it is at least 150 mm wide and on average at most 40
// mm thick. At least half of the samples must show such a cross-section on the same side. Of all
// samples, nine in ten must have something above -300 HU in most of this cross-section. A connected
// component of the material is part of the table under two conditions. First, at least 80 % of its
// volume lies in the cross-section. Second, at least 30 % of its surface in the cross-section
// borders on air; the surface of a bone borders on soft tissue. (Only surface that borders on air
// or on soft tissue is counted.)
//
// No table is found in a scan without a large body, in slices that are narrower than 150 mm or not
// axial, or if the material is not given by a threshold in HU. In these cases at most a few slices
// are read.
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
  /// are treated as empty, because meshing reports their errors. Returns no value if no table is
  /// found in the material. O(voxels) if there is a table; otherwise only samples are read.
  static std::optional<ScannerTable> find(const SliceStack& stack, const Segmentation& how);

  /// The table's voxels, as runs of pixels within a row, in ascending order. There are no runs if
  /// the whole table is connected with other material.
  struct Run {
    std::size_t begin = 0, end = 0;  ///< (slice * height + y) * width + x
  };
  const std::vector<Run>& runs() const { return runs_; }

  /// Lowers the table's pixels in a slice's field below the iso-value (put_on_side()). (offset_x,
  /// offset_y) is the position of a cropped field in its slice.
  void remove(int slice, int offset_x, int offset_y, Field& field) const;

  /// Warnings: table_removed if a table was found, table_connected if a part of it was kept because
  /// it is connected with other material.
  const std::vector<Warning>& warnings() const { return warnings_; }

 private:
  std::size_t width_ = 0, height_ = 0;
  std::vector<Run> runs_;
  std::vector<Warning> warnings_;
};

}  // namespace trocar::pipeline
