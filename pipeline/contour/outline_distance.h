// SPDX-License-Identifier: GPL-3.0-or-later
// How far two outlines are from each other, whatever rings they consist of. (hausdorff_mm() of
// simplification.h compares rings that correspond to each other.)
#pragma once

#include <span>
#include <vector>

#include "pipeline/contour/segment_distance.h"

namespace trocar::pipeline {

/// A closed polygon in mm, without its first point repeated; at least one point.
using OutlineRing = std::vector<Point>;

/// The two-sided Hausdorff distance between the rings' edges, in mm, too small by `accuracy_mm` at
/// most, which must be positive. 0 if neither has a ring, infinite if one of them has none.
double outline_distance_mm(std::span<const OutlineRing> a, std::span<const OutlineRing> b,
                           double accuracy_mm = 1e-3);

}  // namespace trocar::pipeline
