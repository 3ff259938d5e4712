// SPDX-License-Identifier: Apache-2.0
// Makes all edges of the sheet locally Delaunay again. This is the last stage of a cut. An edge
// between two triangles is locally Delaunay if the two angles opposite the edge add up to at most
// 180 degrees. If it is not, a flip replaces it by the other diagonal of the quadrangle that the
// two triangles form (Lawson 1977). The flips start at the edges that new and kept triangles have
// in common, and continue from there as far as necessary.
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
/// so the sheet stays valid. The loop terminates, because no flip is ever undone: if every vertex
/// had the height x^2 + y^2, each flip would lower the surface of the triangles. `flips` receives
/// the number of flips. If more triangles must be tested than `space` can hold, the function stops
/// and returns kCapacity. The caller can then undo the changes with `edit`.
StageOutcome restore_delaunay(SheetMesh& mesh, std::span<const TriangleEdge> edges,
                              FlipSpace& space, SheetEdit& edit, std::uint32_t& flips) noexcept;

}  // namespace trocar::runtime
