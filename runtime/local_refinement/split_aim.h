// SPDX-License-Identifier: Apache-2.0
// Chooses the position at which a boundary edge of a sheet is split, so that refinement terminates
// even at acute corners.
// Tests: tests/runtime/local_refinement/local_refinement_test.cpp
#pragma once

#include "formats/geometry/segment_split.h"
#include "runtime/sheet_mesh/sheet_mesh.h"

namespace trocar::runtime {

/// Returns the wanted position of the next split of the boundary edge `e`. Repeated splits divide
/// the edge into about `parts` (at least 2) equal parts. If exactly one end of the edge is an acute
/// corner (kAcuteCorner_deg), `parts` has no effect: the position lies on a circle around that
/// corner whose radius, in steps, is a power of two. (So all splits near the corner lie on the same
/// concentric circles.) O(triangles at the edge's ends).
SplitAim aim_split(const SheetMesh& mesh, TriangleEdge e, int parts) noexcept;

}  // namespace trocar::runtime
