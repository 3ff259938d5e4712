// SPDX-License-Identifier: Apache-2.0
// The geometry of one slice: the outline of its material, called the PSLG (planar straight-line
// graph), and the triangle mesh of the material. Both are on the lattice.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "formats/mesh/lattice.h"

namespace trocar {

/// A simple closed polygon, without its first point repeated at the end. Outer boundaries run
/// counter-clockwise, holes clockwise (material on the left). Rings may touch at vertices, but they
/// neither cross nor share an edge.
using Ring = std::vector<LatticePoint>;

struct Pslg {
  std::vector<Ring> rings;
};

using Triangle = std::array<std::uint32_t, 3>;  ///< vertex indices, counter-clockwise

struct SliceMesh {
  std::vector<LatticePoint> vertices;
  std::vector<Triangle> triangles;
};

/// Twice the signed area of a ring, in steps^2. Exact for a simple ring, otherwise modulo 2^64.
std::int64_t doubled_area(const Ring& ring);
/// Sum of the doubled areas of the rings; those of holes are negative. Exact.
std::int64_t doubled_area(const Pslg& pslg);
/// Sum of the doubled areas of the triangles. Exact.
std::int64_t doubled_area(const SliceMesh& mesh);

/// Splits a closed path into simple rings at the points that the path visits more than once.
/// Appends the rings to `out`.
void split_at_pinches(const Ring& path, std::vector<Ring>& out);

/// The boundary of a valid mesh as simple rings with the material on the left. A closed path of
/// boundary edges that passes a point twice becomes several rings. Each ring starts at the vertex
/// with the smallest x and, among those, the smallest y. The rings are sorted lexicographically by
/// their vertices. So the result does not depend on the order of the triangles. O(n log n).
Pslg boundary_rings(const SliceMesh& mesh);

inline constexpr std::uint32_t kNotOnBoundary = 0xffffffff;
/// Returns the same rings as boundary_rings(), for a caller that already knows the boundary.
/// Precondition: next[v] is the next vertex after v along the boundary, or kNotOnBoundary.
Pslg rings_along(const SliceMesh& mesh, std::vector<std::uint32_t> next);

}  // namespace trocar
