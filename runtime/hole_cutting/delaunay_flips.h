// SPDX-License-Identifier: Apache-2.0
// Last stage of a cut: Lawson's flips (Lawson 1977) of edges on
// the rim and, as far as necessary, of edges of kept triangles.
// Tests: tests/runtime/hole_cutting/cut_property_test.cpp
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "runtime/hole_cutting/cavity.h"
#include "runtime/sheet_mesh/sheet_edit.h"

namespace trocar::runtime {

struct FlipSpace {
  std::vector<std::uint32_t> waiting;
  FlatTable waits;  ///< 1 for each triangle that is in `waiting`

  void allocate(std::size_t max_triangles);
};

/// Flips edges until all of `edges`, and all edges of triangles that the flips change, are locally
/// Delaunay (an exact test). If all other inner edges of a valid sheet were locally Delaunay
/// before, all inner edges are so afterwards. Each flip exchanges the diagonals of a strictly
/// convex quadrangle, so the sheet stays valid. The loop terminates because every flip lowers the
/// surface that results from lifting the vertices to a paraboloid. `flips` receives the number of
/// flips. If there are more triangles than `space` can hold, returns kCapacity. The caller can then
/// undo the changes with `edit`.
StageOutcome restore_delaunay(SheetMesh& mesh, std::span<const TriangleEdge> edges,
                              FlipSpace& space, SheetEdit& edit, std::uint32_t& flips) noexcept;

}  // namespace trocar::runtime
