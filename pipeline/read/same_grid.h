// SPDX-License-Identifier: GPL-3.0-or-later
// Whether two stacks have their voxels in the same places. Nothing is resampled.
#pragma once

#include <optional>
#include <string>

#include "formats/base/result.h"
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

/// Errors (refused): sizes, spacing, orientation or origin differ; `label_map` and `ct` are their
/// names.
Result<void> check_same_grid(const SliceStack& labels, const std::string& label_map,
                             const SliceStack& hu, const std::string& ct);

}  // namespace trocar::pipeline
