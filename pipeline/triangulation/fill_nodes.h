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

/// Lists the points of a lattice of equilateral triangles that lie inside triangles of the mesh
/// that are larger than these, or on their sides. A point on a side of two triangles may appear
/// twice. The equilateral triangles have the area doubled_area / 2, in lattice steps squared, and
/// edges of at least 2 steps. `triangles` is their approximate number. It bounds the running
/// time, so that for some outlines not all points are found. If the mesh is moved, the points
/// move with it.
void list_fill_nodes(const RefinementMesh& mesh, double doubled_area, double triangles,
                     std::vector<FillNode>& nodes);

/// The edge length of an equilateral triangle, given twice its area.
double fill_edge(double doubled_area);

}  // namespace trocar::pipeline
