// SPDX-License-Identifier: Apache-2.0
// Copies the part of a sheet around the tool into a separate mesh. From this copy, region.h makes a
// region: it cuts the tool's outline out and refines the mesh. The stiffness under the tool is
// computed on the region.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "formats/geometry/slice_mesh.h"
#include "runtime/sheet_mesh/sheet_mesh.h"

namespace trocar::runtime {

/// A circle around the tool, in lattice steps.
struct Circle {
  Eigen::Vector2d centre = Eigen::Vector2d::Zero();
  double radius = 0;
};
/// Returns the circle whose centre is the mean of the tool's corners and whose radius is the
/// distance of the farthest corner. For a regular polygon this is the circumscribed circle.
/// `tool` must not be empty.
Circle circle_around(const Ring& tool) noexcept;

/// A directed edge of the sheet with the copied part on its left and the rest of the sheet
/// on its right.
struct OuterEdge {
  LatticePoint from, to;
  // NOLINTNEXTLINE(modernize-use-nullptr): clang-tidy 14 takes the comparison with 0 for a pointer
  friend auto operator<=>(const OuterEdge&, const OuterEdge&) = default;
};

struct SheetPart {
  SliceMesh mesh;                                    ///< a valid mesh
  std::vector<std::array<std::uint32_t, 3>> across;  ///< neighbours, as in SheetMesh::across
  std::vector<std::uint32_t> parent;                 ///< slot of each vertex in the sheet
  std::vector<OuterEdge> outer;  ///< the part's border to the rest of the sheet, in ascending order
};

/// Returns the part of the sheet around `circle`. The part consists of the triangles `seeds`, and
/// of every near triangle that is connected with the seeds through near triangles. A triangle is
/// near if its distance from the disc within `circle` is less than `radius` lattice steps.
/// (`radius` is not Circle::radius.) The search starts at the seeds, in their order, and goes
/// outwards from triangle to triangle (breadth first). So the same arguments give the same part, in
/// the same order. `queue` is scratch memory. O(part log part).
SheetPart part_around(const SheetMesh& sheet, std::span<const std::uint32_t> seeds,
                      const Circle& circle, double radius, std::vector<std::uint32_t>& queue);

/// Converts the part to a sheet mesh with vertices and triangles in the same order. The mesh also
/// gets `spare_vertices` free slots for vertices and `spare_triangles` free slots for triangles,
/// for those that refinement will add. O(slots).
SheetMesh to_sheet(const SheetPart& part, std::size_t spare_vertices, std::size_t spare_triangles);

}  // namespace trocar::runtime
