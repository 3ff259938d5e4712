// SPDX-License-Identifier: Apache-2.0
// What holds a region's nodes, found from its sides: those along the tool, those that face the rest
// of the sheet, and the sheet's own outline.
#pragma once

#include <cstdint>
#include <vector>

#include "runtime/deformation/network.h"
#include "runtime/deformation/part.h"
#include "runtime/mesh/sheet_mesh.h"

namespace trocar::runtime {

/// From a place to the tool's outline, in steps. O(corners).
double distance_to_outline(const Ring& tool, double x, double y) noexcept;

/// The boundary's sides, each with the vertex that it starts from (there is one at most, as a
/// vertex has one fan of triangles), by vertex slot.
struct BoundarySides {
  std::vector<std::uint32_t> next;  ///< where the side ends; kNone: none starts here
  std::vector<NodeKind> kind;       ///< of the side
};

/// The sides of the mesh that the tool has been cut out of: kTool if a side runs along the tool,
/// kRing if it is one of `outer` (ascending), else kFree. O(slots).
BoundarySides classified_sides(const SheetMesh& mesh, const std::vector<OuterSide>& outer,
                               const Ring& tool, const Circle& circle);

/// The kinds of the nodes, by slot, of a mesh that has been refined since `before` was found: the
/// sides into which one was split are of its kind. A node between two kinds is held rather than
/// free, and by the tool rather than by the ring. O(slots).
std::vector<NodeKind> node_kinds(const SheetMesh& refined, const BoundarySides& before,
                                 const Ring& tool, const Circle& circle);

}  // namespace trocar::runtime
