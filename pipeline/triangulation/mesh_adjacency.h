// SPDX-License-Identifier: GPL-3.0-or-later
// Finds the neighbours of each triangle of a mesh.
// Tests: tests/pipeline/triangulation/triangulation_test.cpp
#pragma once

#include <array>
#include <vector>

#include "formats/geometry/slice_mesh.h"
#include "formats/geometry/triangle_edge.h"

namespace trocar::pipeline {

/// One entry for each triangle and each of its edges (triangle_edge.h): the number of the same edge
/// in the neighbouring triangle, or kNoEdge if the edge is on the boundary.
using Neighbours = std::vector<std::array<EdgeId, 3>>;

/// Finds the neighbours in a mesh. Precondition: the mesh is valid. O(n).
Neighbours neighbours(const SliceMesh& mesh);

}  // namespace trocar::pipeline
