// SPDX-License-Identifier: Apache-2.0
// Last stage of a cut: makes all edges of the sheet locally Delaunay again, by Lawson's flips
// (Lawson 1977). The flips start at the edges that new and kept triangles have in common, and
// continue from there as far as necessary.
// Tests: tests/runtime/hole_cutting/cut_property_test.cpp
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "runtime/hole_cutting/cavity.h"
#include "runtime/sheet_mesh/sheet_edit.h"

namespace trocar::runtime {

struct FlipSpace {
  std::vector<std::uint32_t> waiting;  ///< triangles whose edges must be tested
  FlatTable waits;                     ///< key: triangle; value: 1 if it is in `waiting`, else 0

  void allocate(std::size_t max_triangles);
};

/// Flips edges until all of `edges`, and all inner edges of triangles that the flips change, are
/// locally Delaunay by an exact test. Precondition: `edges` are inner edges of a valid sheet. If
/// all other inner edges of the sheet are locally Delaunay at the start, all inner edges are
/// locally Delaunay at the end. Each flip exchanges the diagonals of a strictly convex quadrangle,
/// so the sheet stays valid. If the vertices are lifted to a paraboloid, every flip lowers the
/// lifted surface, so the loop terminates. `flips` receives the number of flips. If more
/// triangles must be tested than `space` can hold, returns kCapacity. The caller can then undo
/// the changes with `edit`.
StageOutcome restore_delaunay(SheetMesh& mesh, std::span<const TriangleEdge> edges,
                              FlipSpace& space, SheetEdit& edit, std::uint32_t& flips) noexcept;

}  // namespace trocar::runtime
