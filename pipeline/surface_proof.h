// SPDX-License-Identifier: GPL-3.0-or-later
// Self-intersections of a triangle surface, by CGAL's exact predicates.
#pragma once

#include <vector>

#include "formats/geometry/triangle_surface.h"

namespace trocar::pipeline {

/// Triangles that have more in common with another than a vertex or an edge that they share,
/// ascending and each once. Empty: the surface has no self-intersection. Coordinates are integers,
/// so nothing is rounded. All indices must be in range. O(n log n) for most surfaces.
std::vector<std::size_t> self_intersecting_triangles(const TriangleSurface& surface);

}  // namespace trocar::pipeline
