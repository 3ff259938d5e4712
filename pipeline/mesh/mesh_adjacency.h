// SPDX-License-Identifier: GPL-3.0-or-later
// Which edge of which triangle lies beyond each edge of a mesh.
#pragma once

#include <array>
#include <vector>

#include "formats/geometry/slice_mesh.h"
#include "formats/geometry/triangle_edge.h"

namespace trocar::pipeline {

/// By triangle and edge (triangle_edge.h): the same edge as an edge of the triangle beyond it;
/// kNoEdge at the boundary.
using Neighbours = std::vector<std::array<EdgeId, 3>>;

/// Of a valid mesh. O(n).
Neighbours neighbours(const SliceMesh& mesh);

}  // namespace trocar::pipeline
