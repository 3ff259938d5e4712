// SPDX-License-Identifier: GPL-3.0-or-later
// Lists the points at which refinement may insert vertices to divide triangles that are too large.
#pragma once

#include <cstdint>
#include <vector>

#include "pipeline/triangulation/refinement_mesh.h"

namespace trocar::pipeline {

/// A point at which a vertex may be inserted to divide a triangle that is too large.
struct FillNode {
  std::uint32_t triangle;  ///< the triangle that contains the point
  LatticePoint p;
};

/// Lists points of a regular grid of equilateral triangles that covers the mesh. `doubled_area` is
/// twice the area of one equilateral triangle, in steps^2. A grid point is listed if it lies in a
/// triangle of the mesh that is larger than an equilateral triangle of the grid, or on a side of
/// such a large triangle. A point on a side of two triangles may appear twice. If the mesh is
/// moved, the points move with it.
///
/// `triangles` is the caller's estimate of how many equilateral triangles fill the mesh. The
/// estimate limits the work: the function stops after 16 * (triangles + vertices of the mesh) rows
/// of grid points. A row that crosses several large triangles counts once for each of them. For
/// some outlines the function stops before it has found all points. Precondition: the edges of the
/// equilateral triangles have at least 2 steps.
void list_fill_nodes(const RefinementMesh& mesh, double doubled_area, double triangles,
                     std::vector<FillNode>& nodes);

/// The edge length of an equilateral triangle with this doubled area.
double fill_edge(double doubled_area);

}  // namespace trocar::pipeline
