// SPDX-License-Identifier: GPL-3.0-or-later
// Tests: tests/pipeline/triangulation/meshing_test.cpp
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

/// Lists points of a regular grid of equilateral triangles that covers the mesh. Each
/// equilateral triangle has the area doubled_area / 2, in lattice steps squared. A grid point
/// is listed if it lies in a triangle of the mesh that is larger than this area, or on a side
/// of such a triangle. A point on a side of two triangles may appear twice. If the mesh is
/// moved, the points move with it.
///
/// `triangles` is the caller's estimate of how many equilateral triangles fill the mesh. It limits
/// the work: the function visits at most 16 * (triangles + vertices of the mesh) rows of grid
/// points. A row that crosses several triangles of the mesh counts once for each of them. For some
/// outlines the function therefore does not find all points. Precondition: the edges of the
/// equilateral triangles have at least 2 steps.
void list_fill_nodes(const RefinementMesh& mesh, double doubled_area, double triangles,
                     std::vector<FillNode>& nodes);

/// The edge length of an equilateral triangle with this doubled area.
double fill_edge(double doubled_area);

}  // namespace trocar::pipeline
