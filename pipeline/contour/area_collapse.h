// SPDX-License-Identifier: GPL-3.0-or-later
// Reduces the number of vertices on the outline while keeping every ring's area, by segment
// collapse (Kronenfeld, Stanislawski, Buttenfield and Brockmeyer, 2020). Each step is checked
// exactly on the lattice.
#pragma once

#include <vector>

#include "formats/mesh/slice_mesh.h"
#include "pipeline/contour/outline_clearance.h"

namespace trocar::pipeline {

/// Returns one ring for each ring of `contours`, in the same order. simplify() (simplification.h)
/// calls this function. Precondition: `contours` passes check_pslg(). Each step replaces two to
/// seven consecutive vertices of a ring by one lattice point, so that the ring keeps its area.
/// Rounding the point to the lattice changes the area a little; the next steps of the ring correct
/// this error. A step is made only if three conditions hold:
///  - The new edges cross nothing.
///  - No vertex lies in the area between the old edges and the new ones.
///  - The two-sided Hausdorff distance between the new edges and the part of the contour that they
///    replace is at most left_for_collapse(tolerance).
/// `tolerance` is in lattice steps. O(n log n) typically.
///
/// If is_open[i] is true, contour i is a line. Its first and last vertex stay, are not joined, and
/// may belong to other lines too. The area of a line is the signed area that the line would enclose
/// together with the straight segment from its last vertex to its first. A line keeps this area.
SimplifiedOutline collapse_segments(const Pslg& contours, double tolerance,
                                    const std::vector<bool>& is_open = {});

/// The part of the tolerance that is reserved for refinement, which rounds new points of an edge to
/// the lattice. The result and `tolerance` are in lattice steps. The part is a tenth of the
/// tolerance, but at least half a step. For a tolerance below one step, it is half the tolerance.
double left_for_refinement(double tolerance);

/// The rest of the tolerance, which collapse_segments() uses.
double left_for_collapse(double tolerance);

}  // namespace trocar::pipeline
