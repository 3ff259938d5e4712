// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstdint>
#include <vector>

#include "pipeline/mesh/refinement_mesh.h"

namespace trocar::pipeline {

/// A point that may fill a large triangle.
struct FillNode {
  std::uint32_t triangle;  ///< where it lies
  LatticePoint p;
};

/// The points of the lattice of equilateral triangles of this area (doubled, in steps; edges at
/// least 2 long) that lie in larger triangles of the mesh, or on their sides; twice where on a side
/// of two. `triangles` is how many there are about, for a bound on the time: it need not find all.
/// The same elsewhere for a mesh moved.
void list_fill_nodes(const RefinementMesh& mesh, double doubled_area, double triangles,
                     std::vector<FillNode>& nodes);

/// The length of that lattice's edges.
double fill_edge(double doubled_area);

}  // namespace trocar::pipeline
