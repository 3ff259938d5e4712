// SPDX-License-Identifier: GPL-3.0-or-later
// Compares the voxel grids of two stacks, for example of a label map and its CT. The two are used
// together only if the grids are equal, because nothing is resampled.
#pragma once

#include <optional>
#include <string>

#include "pipeline/read/slice_stack.h"

namespace trocar::pipeline {

/// Two grids are equal if no pixel is shifted by more than this fraction of a voxel's side from one
/// to the other. Differences in spacing, orientation and origin all shift pixels.
inline constexpr double kSameVoxel = 1e-3;

/// Describes how `plane` differs from `other`, for example "spacing is 1 x 1 mm, not 1 x 1.5".
/// Returns std::nullopt if there is no difference above kSameVoxel. Both planes have width x height
/// pixels. `step_mm` is the distance between slices.
std::optional<std::string> plane_difference(const SlicePlane& plane, const SlicePlane& other,
                                            int width, int height, double step_mm);

/// The distance from a slice to the next slice. For the last slice, it is the distance from the
/// slice before. If there is only one slice, it is the smaller of that slice's pixel spacings.
double slice_step_mm(const SliceStack& stack, int slice);

/// The first difference between the grids of two stacks.
struct GridDifference {
  /// Index of the first slice that differs. It is -1 if the difference seems to concern all slices,
  /// that is, if the sizes, the slice distances or the first slices of the two stacks differ.
  int slice = -1;
  std::string what;  ///< description, such as "size is ... voxels, not ..."
};
/// Returns no value if the grids are equal.
std::optional<GridDifference> grid_difference(const SliceStack& stack, const SliceStack& other);

}  // namespace trocar::pipeline
