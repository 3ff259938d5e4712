// SPDX-License-Identifier: GPL-3.0-or-later
// The distance between two outlines, which may consist of different rings. (hausdorff_mm() of
// simplification.h compares rings that correspond to each other.)
#pragma once

#include <span>
#include <vector>

#include "pipeline/contour/segment_distance.h"

namespace trocar::pipeline {

/// A closed polygon in mm with at least one point. The first point is not repeated at the end.
using OutlineRing = std::vector<Point>;

/// The two-sided Hausdorff distance between the rings' edges, in mm. The result is below the exact
/// distance by at most `accuracy_mm`, which must be positive. It is 0 if neither outline has a
/// ring, and infinite if only one of them has none.
double outline_distance_mm(std::span<const OutlineRing> a, std::span<const OutlineRing> b,
                           double accuracy_mm = 1e-3);

}  // namespace trocar::pipeline
