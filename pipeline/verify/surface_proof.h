// SPDX-License-Identifier: GPL-3.0-or-later
// Finds the triangles of a surface that intersect each other, with the library CGAL.
#pragma once

#include <vector>

#include "formats/base/result.h"
#include "formats/geometry/triangle_surface.h"

namespace trocar::pipeline {

/// The indices of the triangles that intersect another triangle in more than a common vertex or
/// edge, in ascending order without repetition. The list is empty if the surface has no
/// self-intersection. Coordinates are integers, so nothing is rounded. Precondition: the triangles
/// refer only to vertices that exist. Errors: kRefused if the triangles do not fit together as a
/// manifold, because CGAL then cannot test all of them; check_triangle_surface() tells why. The
/// time is O(n log n) for most surfaces with n triangles.
Result<std::vector<std::size_t>> self_intersecting_triangles(const TriangleSurface& surface);

}  // namespace trocar::pipeline
