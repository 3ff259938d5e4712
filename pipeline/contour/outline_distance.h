// SPDX-License-Identifier: GPL-3.0-or-later
// The distance between two outlines that may have different numbers of rings. If ring i of one
// outline belongs to ring i of the other, use hausdorff_mm() of simplification.h instead.
#pragma once

#include <span>
#include <vector>

#include "pipeline/contour/segment_distance.h"

namespace trocar::pipeline {

/// A closed polygon in mm with at least one point. The first point is not repeated at the end.
using OutlineRing = std::vector<Point>;

/// The two-sided Hausdorff distance between all edges of a and all edges of b, in mm. The result is
/// at most `accuracy_mm` below the exact distance. Precondition: `accuracy_mm` is positive. The
/// result is 0 if neither outline has a ring, and infinite if only one of them has none.
double outline_distance_mm(std::span<const OutlineRing> a, std::span<const OutlineRing> b,
                           double accuracy_mm = 1e-3);

}  // namespace trocar::pipeline
