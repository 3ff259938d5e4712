// SPDX-License-Identifier: GPL-3.0-or-later
// Finds the scanner's table, or a head holder, in the material of a scan in HU, so that it can be
// removed from the material.
//
// A table is a rigid plate or shell along the scan with the same cross-section in every slice. The
// search evaluates up to ten slices, the samples, on a grid of about 2.5 mm. In a sample, the body
// is the region above -300 HU into which a disc of radius 10 mm fits. The cross-section of a table
// is everything above -300 HU that lies on one side of the body and more than 5 mm from it. It must
// be at least 150 mm wide and on average at most 40 mm thick. At least half of the samples must
// show such a cross-section on the same side. (In the others, the body may lie on the table.) The
// area that most of these cross-sections have in common is then compared with all samples: in at
// least nine of ten, most of this area must be above -300 HU.
//
// A connected component of the material is part of the table under two conditions. First, at least
// 80 % of its volume lies in the cross-section. Second, at least 30 % of its surface in the
// cross-section borders on air; the surface of a bone borders on soft tissue. (Only surface that
// borders on air or on soft tissue is counted.)
//
// No table is found in a scan without a large body, in slices whose sides are both below 150 mm, in
// slices that are not axial, or if the material is not given by a threshold in HU. In these cases
// at most a few slices are read.
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
  /// Searches the whole scan for a table, even if only some slices are meshed. Slices that cannot
  /// be read are treated as empty, because meshing reports their errors. Returns no value if no
  /// table is found. O(voxels) if there is a table; otherwise only samples are read.
  static std::optional<ScannerTable> find(const SliceStack& stack, const Segmentation& how);

  /// The table's voxels, as runs of pixels within a row, in ascending order. There are no runs if
  /// the whole table is connected with other material.
  struct Run {
    std::size_t begin = 0, end = 0;  ///< (slice * height + y) * width + x
  };
  const std::vector<Run>& runs() const { return runs_; }

  /// Lowers the table's pixels in the field of a slice below the iso-value (put_on_side()). If the
  /// field is cropped, (offset_x, offset_y) is the slice's pixel at which it begins.
  void remove(int slice, int offset_x, int offset_y, Field& field) const;

  /// Warnings: table_removed if the table or a part of it is removed, table_connected if more than
  /// a fifth of it is kept because it is connected with other material.
  const std::vector<Warning>& warnings() const { return warnings_; }

 private:
  std::size_t width_ = 0, height_ = 0;
  std::vector<Run> runs_;
  std::vector<Warning> warnings_;
};

}  // namespace trocar::pipeline
