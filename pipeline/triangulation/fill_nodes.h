// SPDX-License-Identifier: GPL-3.0-or-later
// Tests: tests/pipeline/triangulation/meshing_test.cpp
#pragma once

#include <cstdint>
#include <vector>

#include "pipeline/triangulation/refinement_mesh.h"

namespace trocar::pipeline {

/// A point that may fill a large triangle.
struct FillNode {
  std::uint32_t triangle;  ///< the triangle that contains the point
  LatticePoint p;
};

/// Lists points of a lattice of equilateral triangles with the area doubled_area / 2 (lattice steps
/// squared). The points are those that lie in triangles of the mesh that are larger than the
/// equilateral ones, or on their sides. A point on a side of two triangles may appear twice.
/// `triangles` is the approximate number of equilateral triangles. It bounds the running time, so
/// for some outlines not all points are found. If the mesh is moved, the points move with it.
/// Precondition: the edges of the equilateral triangles have at least 2 steps.
void list_fill_nodes(const RefinementMesh& mesh, double doubled_area, double triangles,
                     std::vector<FillNode>& nodes);

/// The edge length of an equilateral triangle, given twice its area.
double fill_edge(double doubled_area);

}  // namespace trocar::pipeline
