// SPDX-License-Identifier: GPL-3.0-or-later
// Removes features at the scale of the lattice from a simplified outline: edges of a few lattice
// steps, and parts of the outline that come within a few lattice steps of each other.
// Simplification leaves or creates such features, although the scan contains nothing of that size.
// At that scale the angles of triangles depend on rounding to the lattice.
//
// Definitions, with the clearance c = clearance_steps(tolerance), at most 12 lattice steps:
//  - A tight spot is an edge shorter than c, or two edges without a common end whose distance is
//    less than c (tight_spots.h).
//  - The scan forces a tight spot if every change that clear_outline() tries there would leave the
//    tolerance, change the topology or create another tight spot. The scan also forces sharp
//    corners: two neighbouring edges may meet at any angle. An outline with many more tight spots
//    than vertices is a figure at the scale of the lattice, and is not changed.
//  - A small input angle is an angle below 60 degrees of the outline itself. A free angle is an
//    angle of a triangle that does not lie at a small input angle (see MeshQuality in
//    triangulation/mesh_quality.h). With rare exceptions, the mesh of an outline without tight
//    spots has no free angle below 30 degrees. The reason is that refinement makes no edge much
//    shorter than the clearance, and that it moves points by only one lattice step or two when it
//    rounds them to the lattice. The test bounds how often an exception occurs. There is one
//    systematic exception: if the method is Douglas-Peucker, simplify() does not clear an outline
//    that a rotation maps to itself, and the free angles of this outline stay.
#pragma once

#include <cstdint>
#include <vector>

#include "formats/geometry/slice_mesh.h"
#include "pipeline/contour/collapse_geometry.h"

namespace trocar::pipeline {

inline constexpr double kClearance_steps = 12;  ///< lattice steps

/// A simplified outline, with the data that later steps need to stay within the tolerance and to
/// keep the areas.
struct SimplifiedOutline {
  Pslg outline;
  /// Each vertex of each ring has a position on the contour of the same index, within the tolerance
  /// of the vertex. The positions of successive vertices follow each other along the contour.
  std::vector<std::vector<collapse::ContourPosition>> positions;
  /// Twice the area that each ring lacks, or 0 if areas are not kept.
  std::vector<std::int64_t> area_errors;
};

/// The clearance for a tolerance in lattice steps: kClearance_steps, but at most half of the
/// tolerance, because larger features may be wanted.
double clearance_steps(double tolerance);

/// Removes the tight spots that the scan does not force, by merging two vertices into one or by
/// moving a vertex, each by a few lattice steps. A change is made only if four conditions hold: the
/// new edges cross nothing, no vertex lies in the area that they sweep, the new edges and the part
/// of the contour that they replace are within `tolerance` (lattice steps) of each other, and fewer
/// tight spots remain. Rings, their nesting and shared ends are therefore preserved. Then vertices
/// move by up to two lattice steps at a time to restore the area of each ring. The areas are also
/// restored if the outline has no tight spot but lacks more than 0.02 % of its area. If `is_open`
/// is given, contours for which it is true are lines whose ends stay. The result does not depend on
/// the order of rings. If the outline is moved or rotated by right angles, the result moves and
/// rotates with it. O(n log n) typically; without tight spots the function takes a fraction of the
/// time of simplification.
void clear_outline(const Pslg& contours, const std::vector<bool>& is_open, double tolerance,
                   SimplifiedOutline& simplified);

}  // namespace trocar::pipeline
