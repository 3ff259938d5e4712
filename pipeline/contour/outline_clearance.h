// SPDX-License-Identifier: GPL-3.0-or-later
// Removes features at the scale of the lattice from a simplified outline: edges of a few lattice
// steps, and parts of the outline that come within a few lattice steps of each other.
// Simplification leaves or creates such features, although the scan contains nothing of that size.
// At that scale the angles of triangles depend on rounding to the lattice, and some become small.
//
// Definitions, with the clearance c = clearance_steps(tolerance), at most 12 lattice steps:
//  - A tight spot is an edge shorter than c, or two edges without a common end whose distance is
//    less than c.
//  - The scan forces a tight spot if clear_outline() finds no change there that stays within the
//    tolerance, keeps the topology and reduces the number of tight spots.
//  - A small input angle is an angle of the outline itself that is below 60 degrees. Some triangles
//    lie at a small input angle (SharpTriangle in triangulation/mesh_quality.h). The angles of all
//    other triangles are free angles.
//
// Effect: with rare exceptions, the mesh of an outline without tight spots has no free angle below
// 30 degrees. The reason is that refinement makes no edge much shorter than the clearance, while
// rounding to the lattice moves a point by only one or two lattice steps.
// outline_clearance_test.cpp bounds how often an exception occurs.
//
// The following are not changed:
//  - Sharp corners: two neighbouring edges may meet at any angle.
//  - Tight spots of an outline that has many more tight spots than vertices. Such an outline is a
//    figure at the scale of the lattice.
//  - Outlines that a rotation by right angles may map to themselves, if the method is
//    Douglas-Peucker. For such an outline, the order of changes would depend on its orientation.
//    The meshes of these outlines can have free angles below 30 degrees.
#pragma once

#include <cstdint>
#include <vector>

#include "formats/mesh/slice_mesh.h"
#include "pipeline/contour/collapse_geometry.h"

namespace trocar::pipeline {

inline constexpr double kClearance_steps = 12;  ///< largest clearance, in lattice steps

/// A simplified outline, with the data that later steps need to stay within the tolerance and to
/// keep the areas.
struct SimplifiedOutline {
  Pslg outline;
  /// A position for each vertex of each ring. It lies on the contour with the index of the ring,
  /// within the tolerance of the vertex. The positions of successive vertices follow each other
  /// along the contour.
  std::vector<std::vector<collapse::ContourPosition>> positions;
  /// A number for each ring: twice the area of the ring's contour minus twice the area of the ring,
  /// in squared lattice steps. It is 0 if the method does not keep areas.
  std::vector<std::int64_t> area_errors;
};

/// Removes from `simplified.outline` the tight spots that the scan does not force. A change merges
/// two vertices into one or moves one vertex. It is made only if four conditions hold:
///  - The new edges cross nothing.
///  - No vertex lies in the area between the old edges and the new ones.
///  - The two-sided Hausdorff distance between the new edges and the part of the contour that they
///    replace is at most `tolerance` (lattice steps).
///  - Fewer tight spots remain.
/// The rings, their nesting and the common ends of lines are therefore preserved. Finally single
/// vertices move to restore the area of each ring. Each move is at most two lattice steps in x and
/// in y. This is also done if the outline has no tight spot but its total area is wrong by more
/// than 0.02 %. If is_open[i] is true, contour i is a line, and its ends stay. If there are no
/// lines, `is_open` may be empty. The result does not depend on the order of rings. If the outline
/// is moved or rotated by right angles, the result moves and rotates with it. If `tolerance` is
/// less than two lattice steps, nothing changes. `positions` and `area_errors` of `simplified` are
/// not updated. O(n log n) typically; without tight spots the function takes a fraction of the time
/// of simplification.
void clear_outline(const Pslg& contours, const std::vector<bool>& is_open, double tolerance,
                   SimplifiedOutline& simplified);

}  // namespace trocar::pipeline
