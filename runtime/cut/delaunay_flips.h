// SPDX-License-Identifier: Apache-2.0
// Last stage of a cut: Lawson's flips (Lawson 1977), across the rim and as far into the triangles
// that stay as necessary.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "runtime/cut/cavity.h"
#include "runtime/mesh/sheet_edit.h"

namespace trocar::runtime {

struct FlipSpace {
  std::vector<std::uint32_t> waiting;
  FlatTable waits;  ///< by triangle; 1: it is in `waiting`

  void allocate(std::size_t max_triangles);
};

/// Flips until all of `edges`, and all edges of triangles that this changes, are locally Delaunay,
/// exactly. If all other inner edges of a valid sheet were so before, all are afterwards. Each flip
/// exchanges the diagonals of a strictly convex quadrangle, so the sheet stays valid; it ends
/// because every flip lowers the surface lifted to the paraboloid. `flips` counts them. kCapacity:
/// more triangles than `space` can hold; `edit` can undo what has been done.
StageOutcome restore_delaunay(SheetMesh& mesh, std::span<const TriangleEdge> edges,
                              FlipSpace& space, SheetEdit& edit, std::uint32_t& flips) noexcept;

}  // namespace trocar::runtime
