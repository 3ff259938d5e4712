// SPDX-License-Identifier: Apache-2.0
// Where to split a boundary edge of a sheet, so that refinement ends at acute corners too.
#pragma once

#include "formats/geometry/split_places.h"
#include "runtime/mesh/sheet_mesh.h"

namespace trocar::runtime {

/// For a boundary edge that is to be split into about `pieces` (>= 2) equal parts, one split at a
/// time. Where exactly one of its ends is an acute corner (kAcuteCorner_deg), the aim is a power of
/// two of steps from that corner: one of the concentric shells around it. O(triangles at the edge's
/// ends).
SplitAim aim_split(const SheetMesh& mesh, TriangleEdge e, int pieces) noexcept;

}  // namespace trocar::runtime
