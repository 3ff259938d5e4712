// SPDX-License-Identifier: Apache-2.0
// Constrained Delaunay triangulation of a small PSLG by exact integers:
// incremental insertion with Lawson's flips (Lawson 1977), constraints by
// Sloan's flips (Sloan 1993). The same input gives the same triangles.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "formats/result.h"
#include "formats/slice_mesh.h"

namespace trocar::runtime {

/// A counter-clockwise triangle; side i runs from vertex[i] to vertex[i + 1 mod 3].
struct Cell {
  std::array<std::uint32_t, 3> vertex;
  std::array<std::uint32_t, 3> across;  ///< cell beyond side i, 0xffffffff if there is none
  std::array<bool, 3> locked;           ///< side i is a constraint
};

/// Tiles a box around all points. The box's four corners are the last four points.
struct Triangulation {
  std::vector<LatticePoint> points;
  std::vector<Cell> cells;
};

/// Of distinct points with |coordinate| <= kMaxCoordinate and of constraints that
/// neither cross nor run through a point. Cells are Delaunay before the
/// constraints go in, not after: see restore_delaunay. Typically O(n^1.5).
/// Errors (bug): the input is not as described.
Result<Triangulation> constrained_triangulation(
    const std::vector<LatticePoint>& points,
    const std::vector<std::array<std::uint32_t, 2>>& constraints);

/// Flips until every side between two cells of the same part, other than part
/// 0, is locally Delaunay; `part` has one entry a cell. Constraints within a part
/// are flipped too: what parts two cells is the boundary of their parts alone.
void restore_delaunay(Triangulation& triangulation, const std::vector<std::uint8_t>& part);

}  // namespace trocar::runtime
