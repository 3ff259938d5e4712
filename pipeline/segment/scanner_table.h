// SPDX-License-Identifier: GPL-3.0-or-later
// Finds the scanner's table, or a head holder, in the material of a scan in HU, so that it can be
// removed from the material.
//
// A table is a rigid plate or shell along the scan with the same cross-section in every slice. The
// search evaluates up to ten slices, the samples, on a grid of blocks of about 2.5 mm:
//  1. In each sample, the body is what discs of radius 10 mm can cover without leaving the region
//     above -300 HU. Flat separate parts of this area do not belong to the body.
//  2. The section of a sample on one side (up, down, left or right) is everything above -300 HU
//     that lies on this side of the body and more than 5 mm from it. The section counts if it
//     contains material, is at least 150 mm wide, covers at least 40 % of this width, and is on
//     average at most 40 mm thick.
//  3. At least half of the samples must have a section that counts, on the same side. (In the other
//     samples, the body may be nearer than 5 mm to the table.)
//  4. The core is the set of blocks that lie in at least half of these sections. It must not be
//     empty. In at least 90 % of all samples, at least 60 % of the core must be above -300 HU.
//  5. The table's cross-section is the set of blocks that lie in at least a quarter of the sections
//     of step 3, with a margin of one block.
//
// A connected component of the material is part of the table under two conditions. First, at least
// 80 % of its volume lies in the table's cross-section. Second, at least 30 % of its surface in
// this cross-section borders on air. The second condition excludes bone, whose surface borders on
// soft tissue. (The 30 % refer to the surface that borders on air or on soft tissue within the
// slice. Any other surface is left out of the count.)
//
// No table is found in a scan without a large body, in a single slice, in slices whose sides are
// both below 150 mm, in slices that are not axial or not parallel (check_parallel()), or if the
// material is not given by a threshold in HU. In these cases at most a few slices are read.
#pragma once

#include <cstddef>
#include <optional>
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

  /// Removes the table from the material of a slice: lowers the values of the table's pixels in
  /// `field` below the iso-value. If `field` is a part of the slice, (offset_x, offset_y) is the
  /// slice's pixel at which this part begins.
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
