// SPDX-License-Identifier: Apache-2.0
// Finds how each node of a region is held (NodeKind), from the region's boundary edges. A
// boundary edge lies on the tool, on the border to the rest of the sheet (the ring), or on
// the sheet's outline.
#pragma once

#include <cstdint>
#include <vector>

#include "runtime/deformation/network.h"
#include "runtime/deformation/part.h"
#include "runtime/sheet_mesh/sheet_mesh.h"

namespace trocar::runtime {

/// Returns the distance from a point to the tool's outline, in steps. O(corners).
double distance_to_outline(const Ring& tool, double x, double y) noexcept;

/// The boundary edges of a mesh. An edge is stored at the vertex where it starts: element v of each
/// vector describes the edge that starts at vertex v. At most one boundary edge starts at a vertex,
/// because the triangles of a vertex form one fan (sheet_mesh.h, invariant 3).
struct BoundaryEdges {
  std::vector<std::uint32_t> next;  ///< vertex where the edge ends; kNoSlot: no edge starts at v
  std::vector<NodeKind> kind;       ///< kFree for an edge on the sheet's outline
};

/// Returns the boundary edges of a mesh out of which the tool was cut. `outer` is SheetPart::outer,
/// in ascending order, and `circle` is circle_around(tool). Edges in `outer` are kBorder, edges
/// along the tool are kTool, and all other edges are kFree. O(slots).
BoundaryEdges classified_boundary(const SheetMesh& mesh, const std::vector<OuterEdge>& outer,
                                  const Ring& tool, const Circle& circle);

/// Returns the kind of each vertex slot of the refined mesh. `before` contains the boundary edges
/// before refinement. If refinement split an edge, the parts have the kind of the edge. A node
/// between a kTool edge and another edge is kTool. A node between a kBorder edge and a kFree edge
/// is kBorder. Nodes of the sheet's outline very close to the tool are kTool as well (region.h,
/// contract 2). O(slots).
std::vector<NodeKind> node_kinds(const SheetMesh& refined, const BoundaryEdges& before,
                                 const Ring& tool, const Circle& circle);

}  // namespace trocar::runtime
