// SPDX-License-Identifier: Apache-2.0
// Chooses the position at which refinement splits a boundary edge of a sheet. Near an acute corner
// the positions lie on circles around the corner. Without these circles, the splits of the two
// edges at the corner might make each other necessary without end.
#pragma once

#include "formats/geometry/segment_split.h"
#include "runtime/sheet_mesh/sheet_mesh.h"

namespace trocar::runtime {

/// Returns the wanted position of the next split of the boundary edge `e`. Repeated splits divide
/// the edge into about `parts` (at least 2) equal parts. Exception: if exactly one end of the edge
/// is an acute corner (kAcuteCorner_deg), `parts` has no effect, and the position lies on a circle
/// around that corner. The radius of the circle, in steps, is a power of two, so that both edges at
/// the corner are split on the same circles. O(triangles at the edge's ends).
SplitAim aim_split(const SheetMesh& mesh, TriangleEdge e, int parts) noexcept;

}  // namespace trocar::runtime
