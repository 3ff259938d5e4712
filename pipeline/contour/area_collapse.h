// SPDX-License-Identifier: GPL-3.0-or-later
// Fewer vertices on the outline with every ring's area kept: segment collapse (Kronenfeld,
// Stanislawski, Buttenfield and Brockmeyer, 2020), each step checked exactly on the lattice.
#pragma once

#include <vector>

#include "formats/geometry/slice_mesh.h"

namespace trocar::pipeline {

/// One ring for each ring of `contours` (valid by check_pslg), in the same order; see simplify().
/// Vertices are new lattice points. An edge and its two ends become one point, so placed that the
/// ring's area stays; what rounding to the lattice leaves is passed on to the ring's next step. A
/// step is made only if the new edges cross nothing, no vertex lies in what they sweep, and they
/// are within `tolerance` (lattice steps) of the part of the contour that they stand for, both
/// ways. O(n log n) typically.
/// Of `tolerance` it leaves left_for_refinement() to points that are put beside the edges later.
/// Where `is_open` is given, a contour for which it holds is a line: its first and last vertex
/// stay, may be those of other lines, and are not joined; the line keeps the area between itself
/// and any path that joins its ends.
Pslg collapse_segments(const Pslg& contours, double tolerance,
                       const std::vector<bool>& is_open = {});

/// Lattice steps: a tenth of the tolerance, but no less than half a step or half of the tolerance.
double left_for_refinement(double tolerance);

}  // namespace trocar::pipeline
