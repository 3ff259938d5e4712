// SPDX-License-Identifier: GPL-3.0-or-later
// Whether two stacks have their voxels in the same places. Nothing is resampled.
#pragma once

#include <optional>
#include <string>

#include "pipeline/read/slice_stack.h"

namespace trocar::pipeline {

/// Voxels of two stacks may lie this far apart, in voxels.
inline constexpr double kSameVoxel = 1e-3;

/// How the plane differs from another one of width x height pixels, as in "spacing is 1 x 1 mm, not
/// 1 x 1.5"; none if all its pixels lie within kSameVoxel of the other's. `step_mm` is the height
/// of a voxel.
std::optional<std::string> plane_difference(const SlicePlane& plane, const SlicePlane& other,
                                            int width, int height, double step_mm);

/// From a slice to the next, or, for the last, from the one before; of a single slice its smaller
/// pixel spacing.
double slice_step_mm(const SliceStack& stack, int slice);

/// How the grid of `stack` differs from that of another one.
struct GridDifference {
  int slice = -1;    ///< of `stack`, from the second on; -1: in size, or in the first slice already
  std::string what;  ///< "size is ... voxels, not ..."
};
std::optional<GridDifference> grid_difference(const SliceStack& stack, const SliceStack& other);

}  // namespace trocar::pipeline
