// SPDX-License-Identifier: Apache-2.0
// Chooses the position at which to split a boundary edge of a sheet, so that refinement also
// terminates at acute corners.
// Tests: tests/runtime/local_refinement/local_refinement_test.cpp
#pragma once

#include "formats/geometry/segment_split.h"
#include "runtime/sheet_mesh/sheet_mesh.h"

namespace trocar::runtime {

/// The aim of the next split of a boundary edge that is to be split into about `parts` (>= 2)
/// equal parts, one split at a time. If exactly one of its ends is an acute corner
/// (kAcuteCorner_deg), the aim is at a distance from that corner that is a power of two in steps,
/// that is on one of the concentric shells around it. O(triangles at the edge's ends).
SplitAim aim_split(const SheetMesh& mesh, TriangleEdge e, int parts) noexcept;

}  // namespace trocar::runtime
