// SPDX-License-Identifier: GPL-3.0-or-later
// Fewer vertices on the outline with every ring's area kept: segment collapse (Kronenfeld,
// Stanislawski, Buttenfield and Brockmeyer, 2020), each step checked exactly on the lattice.
#pragma once

#include <vector>

#include "formats/geometry/slice_mesh.h"
#include "pipeline/contour/outline_clearance.h"

namespace trocar::pipeline {

/// Returns one ring for each ring of `contours` (valid by check_pslg), in the same order; see
/// simplify(). Vertices are new lattice points. Each step replaces an edge and its two ends by one
/// point that keeps the ring's area; the rounding error of the area is passed on to the ring's next
/// step. A step is made only if the new edges cross nothing, no vertex lies in the area that they
/// sweep, and the two-sided Hausdorff distance between them and the part of the contour that they
/// replace stays within `tolerance` (lattice steps) less left_for_refinement(), which the mesher
/// needs when it rounds new points of an edge to the lattice. O(n log n) typically.
/// If `is_open` is given, a contour for which it holds is a line: its first and last vertex stay,
/// may belong to other lines too, and are not joined. The line keeps the area between itself and
/// any path that joins its ends.
SimplifiedOutline collapse_segments(const Pslg& contours, double tolerance,
                                    const std::vector<bool>& is_open = {});

/// The part of the tolerance that is left to refinement, in lattice steps like `tolerance`: a tenth
/// of the tolerance, but no less than half a step or, if that is smaller, half of the tolerance.
double left_for_refinement(double tolerance);

/// The part of the tolerance that collapses use.
double left_for_collapse(double tolerance);

}  // namespace trocar::pipeline
