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
/// simplify(). The vertices of the result are new lattice points. Each step replaces an edge and
/// its two ends by one point that keeps the ring's area. The rounding error of the area is carried
/// over to the ring's next step. A step is made only if three conditions hold. The new edges cross
/// nothing. No vertex lies in the area that the step sweeps. The Hausdorff distance between the new
/// edges and the part of the contour that they replace is at most left_for_collapse(tolerance), in
/// both directions. `tolerance` is in lattice steps; the rest of it is reserved for the mesher,
/// which rounds new points of an edge to the lattice. O(n log n) typically.
///
/// If `is_open` is given, a contour for which it is true is a line. The first and last vertex of a
/// line stay, may belong to other lines too, and are not joined. The line keeps the area between
/// itself and any path that joins its ends.
SimplifiedOutline collapse_segments(const Pslg& contours, double tolerance,
                                    const std::vector<bool>& is_open = {});

/// The part of the tolerance that is reserved for refinement, in lattice steps like `tolerance`. It
/// is a tenth of the tolerance, but at least half a step. If the tolerance is below one step, it is
/// half of the tolerance.
double left_for_refinement(double tolerance);

/// The rest of the tolerance, which collapse_segments() uses.
double left_for_collapse(double tolerance);

}  // namespace trocar::pipeline
