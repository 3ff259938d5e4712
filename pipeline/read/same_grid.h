// SPDX-License-Identifier: GPL-3.0-or-later
// Compares the voxel grids of two stacks, since nothing is resampled.
// Tests: tests/pipeline/open/labels_with_ct_test.py
#pragma once

#include <optional>
#include <string>

#include "pipeline/read/slice_stack.h"

namespace trocar::pipeline {

/// Tolerance of the positions of two stacks' voxels, in voxels.
inline constexpr double kSameVoxel = 1e-3;

/// Describes how a plane differs from another one of width x height pixels, as in "spacing is 1 x 1
/// mm, not 1 x 1.5"; no value if all its pixels lie within kSameVoxel of the other's. `step_mm` is
/// the height of a voxel.
std::optional<std::string> plane_difference(const SlicePlane& plane, const SlicePlane& other,
                                            int width, int height, double step_mm);

/// The distance from a slice to the next, or for the last slice from the one before. For a single
/// slice, its smaller pixel spacing.
double slice_step_mm(const SliceStack& stack, int slice);

/// The first difference of the grid of `stack` from another one.
struct GridDifference {
  int slice = -1;    ///< slice of `stack`; -1 if the sizes or the first slices differ
  std::string what;  ///< "size is ... voxels, not ..."
};
std::optional<GridDifference> grid_difference(const SliceStack& stack, const SliceStack& other);

}  // namespace trocar::pipeline
