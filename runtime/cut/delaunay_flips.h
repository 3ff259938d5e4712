// SPDX-License-Identifier: Apache-2.0
// Last stage of a cut: Lawson's flips (Lawson 1977), over the rim and as far into the triangles
// that stay as need be.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "runtime/cut/cavity.h"
#include "runtime/mesh/sheet_edit.h"

namespace trocar::runtime {

struct FlipSpace {
  std::vector<std::uint32_t> waiting;
  FlatTable waits;  ///< by triangle: 1: it is among them

  void allocate(std::size_t max_triangles);
};

/// Flips until all of `sides`, and of what this changes, are locally Delaunay, exactly. If all
/// other sides between two triangles of a valid sheet are so already, then all are. Each flip turns
/// the diagonal of a strictly convex quadrangle, so the sheet stays valid; it ends because the
/// lifted surface sinks with every one. `flips` counts them. kCapacity: more triangles than `space`
/// has room for; `edit` can undo what has been done.
Stage restore_delaunay(SheetMesh& mesh, std::span<const TriangleSide> sides, FlipSpace& space,
                       SheetEdit& edit, std::uint32_t& flips) noexcept;

}  // namespace trocar::runtime
