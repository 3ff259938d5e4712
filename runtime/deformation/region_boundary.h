// SPDX-License-Identifier: Apache-2.0
// Finds the kinds of a region's nodes from the region's boundary edges. A boundary edge lies on the
// tool, on the border to the rest of the sheet (the ring), or on the sheet's outline.
// Tests: tests/runtime/deformation/deformation_region_test.cpp
#pragma once

#include <cstdint>
#include <vector>

#include "runtime/deformation/network.h"
#include "runtime/deformation/part.h"
#include "runtime/sheet_mesh/sheet_mesh.h"

namespace trocar::runtime {

/// Returns the distance from a point to the tool's outline, in steps. O(corners).
double distance_to_outline(const Ring& tool, double x, double y) noexcept;

/// The boundary edges, indexed by the slot of the vertex where they start. At most one edge starts
/// at a vertex, because the triangles of a vertex form one fan (sheet_mesh.h, invariant 3).
struct BoundaryEdges {
  std::vector<std::uint32_t> next;  ///< end vertex of the edge; kNone: no edge starts here
  std::vector<NodeKind> kind;       ///< kind of the edge
};

/// Returns the boundary edges of a mesh out of which the tool was cut. Edges that `outer` lists (in
/// ascending order) are kBorder, edges along the tool are kTool, and all other edges are kFree.
/// `circle`: circle_around(tool). O(slots).
BoundaryEdges classified_boundary(const SheetMesh& mesh, const std::vector<OuterEdge>& outer,
                                  const Ring& tool, const Circle& circle);

/// Returns the kinds of the nodes, by slot, after refinement. `before`: the boundary edges before
/// refinement. The parts of a split edge have the kind of that edge. A node between edges of two
/// kinds gets one of these kinds: kTool if there is one, otherwise kBorder. Nodes of the sheet's
/// outline very close to the tool are kTool as well (region.h, contract 2). O(slots).
std::vector<NodeKind> node_kinds(const SheetMesh& refined, const BoundaryEdges& before,
                                 const Ring& tool, const Circle& circle);

}  // namespace trocar::runtime
