// SPDX-License-Identifier: Apache-2.0
// The kinds of a region's nodes, found from its boundary edges: those along the tool, those towards
// the rest of the sheet (the ring), and those on the sheet's outline.
// Tests: tests/runtime/deformation/deformation_region_test.cpp
#pragma once

#include <cstdint>
#include <vector>

#include "runtime/deformation/network.h"
#include "runtime/deformation/part.h"
#include "runtime/sheet_mesh/sheet_mesh.h"

namespace trocar::runtime {

/// Distance from a point to the tool's outline, in steps. O(corners).
double distance_to_outline(const Ring& tool, double x, double y) noexcept;

/// The boundary edges by the slot of the vertex where they start: at most one for each vertex,
/// which has one fan of triangles.
struct BoundaryEdges {
  std::vector<std::uint32_t> next;  ///< end vertex of the edge; kNone: no edge starts here
  std::vector<NodeKind> kind;       ///< kind of the edge
};

/// The boundary edges of a mesh after the tool was cut out: kTool along the tool, kRing for those
/// of `outer` (ascending), else kFree. O(slots).
BoundaryEdges classified_boundary(const SheetMesh& mesh, const std::vector<OuterEdge>& outer,
                                  const Ring& tool, const Circle& circle);

/// The kinds of the nodes, by slot, after refinement; `before`: the edges before it. The parts of a
/// split edge have its kind. A node between edges of two kinds is kTool rather than kRing, and
/// kRing rather than kFree. O(slots).
std::vector<NodeKind> node_kinds(const SheetMesh& refined, const BoundaryEdges& before,
                                 const Ring& tool, const Circle& circle);

}  // namespace trocar::runtime
