// SPDX-License-Identifier: GPL-3.0-or-later
// Finds the neighbours of each triangle of a mesh.
#pragma once

#include <array>
#include <vector>

#include "formats/geometry/slice_mesh.h"
#include "formats/geometry/triangle_edge.h"

namespace trocar::pipeline {

/// Element [t][i] belongs to edge i of triangle t (numbered as in triangle_edge.h). It identifies
/// the same edge in the neighbouring triangle. It is kNoEdge if the edge is on the boundary.
using Neighbours = std::vector<std::array<EdgeId, 3>>;

/// Finds the neighbours in a mesh. Precondition: the mesh is valid. O(n).
Neighbours neighbours(const SliceMesh& mesh);

}  // namespace trocar::pipeline
