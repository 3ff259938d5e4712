// SPDX-License-Identifier: GPL-3.0-or-later
// Reduces the number of vertices on the outline while keeping every ring's area, by segment
// collapse (Kronenfeld, Stanislawski, Buttenfield and Brockmeyer, 2020). Each step is checked
// exactly on the lattice.
#pragma once

#include <vector>

#include "formats/geometry/slice_mesh.h"
#include "pipeline/contour/outline_clearance.h"

namespace trocar::pipeline {

/// Returns one ring for each ring of `contours` (valid by check_pslg), in the same order; see
/// simplify(). Vertices are new lattice points. Each step replaces an edge and its two ends by one
/// point that keeps the ring's area. The rounding error of the area is carried over to the ring's
/// next step. A step is made only if three conditions hold. The new edges cross nothing. No vertex
/// lies in the area that they sweep. The two-sided Hausdorff distance between them and the part of
/// the contour that they replace stays within `tolerance` (lattice steps) minus
/// left_for_refinement(), which the mesher needs when it rounds new points of an edge to the
/// lattice. O(n log n) typically. If `is_open` is given, a contour for which it is true is a line:
/// its first and last vertex stay, may belong to other lines too, and are not joined. The line
/// keeps the area between itself and any path that joins its ends.
SimplifiedOutline collapse_segments(const Pslg& contours, double tolerance,
                                    const std::vector<bool>& is_open = {});

/// The part of the tolerance that is reserved for refinement, in lattice steps like
/// `tolerance`. It is a tenth of the tolerance, but at least half a step or, if that is
/// smaller, half of the tolerance.
double left_for_refinement(double tolerance);

/// The part of the tolerance that collapses use.
double left_for_collapse(double tolerance);

}  // namespace trocar::pipeline
