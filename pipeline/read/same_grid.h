// SPDX-License-Identifier: GPL-3.0-or-later
// Compares the voxel grids of two stacks. The grids must be equal, because nothing is resampled.
// Tests: tests/pipeline/open/labels_with_ct_test.py
#pragma once

#include <optional>
#include <string>

#include "pipeline/read/slice_stack.h"

namespace trocar::pipeline {

/// Largest allowed distance between corresponding voxels of two stacks, in voxels.
inline constexpr double kSameVoxel = 1e-3;

/// Describes how `plane` differs from `other`, both with width x height pixels, for example
/// "spacing is 1 x 1 mm, not 1 x 1.5". The result is std::nullopt if all pixels lie within
/// kSameVoxel of those of `other`. `step_mm` is the height of a voxel.
std::optional<std::string> plane_difference(const SlicePlane& plane, const SlicePlane& other,
                                            int width, int height, double step_mm);

/// The distance from a slice to the next one; for the last slice, from the slice before it. If
/// there is only one slice, the smaller of its pixel spacings.
double slice_step_mm(const SliceStack& stack, int slice);

/// The first difference between the grid of a stack and another grid.
struct GridDifference {
  int slice = -1;    ///< index of the slice; -1 if sizes, first slices or slice distances differ
  std::string what;  ///< description, such as "size is ... voxels, not ..."
};
std::optional<GridDifference> grid_difference(const SliceStack& stack, const SliceStack& other);

}  // namespace trocar::pipeline
