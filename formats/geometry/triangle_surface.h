// SPDX-License-Identifier: Apache-2.0
// A closed surface of triangles in space, on an integer lattice, for display.
// Tests: tests/formats/asset/asset_surface_test.cpp
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

#include "formats/base/result.h"
#include "formats/geometry/lattice.h"

namespace trocar {

/// A point in space, lattice steps.
using SpacePoint = std::array<std::int32_t, 3>;

/// Largest admissible |coordinate|: a float32 carries it exactly, and no product below overflows.
inline constexpr std::int32_t kMaxSpaceCoordinate = 1 << 24;

/// Triangles are counter-clockwise seen from outside the material.
struct TriangleSurface {
  Lattice lattice;
  std::vector<SpacePoint> vertices;
  std::vector<std::array<std::uint32_t, 3>> triangles;
};

/// Proves the following in exact arithmetic, or names the first vertex or triangle that violates
/// it:
///  - coordinates are admissible, indices in range, every vertex is used, no triangle has area 0;
///  - the surface is closed, manifold and oriented: each edge has two triangles, which traverse it
///    in opposite directions, and the triangles at a vertex form one fan;
///  - it encloses a volume > 0: it is not inside out.
/// Does not detect self-intersections. O(n log n). Errors: (refused).
Result<void> check_triangle_surface(const TriangleSurface& surface);

/// The normal at each vertex: the mean of the unit normals of its triangles, weighted by the
/// triangles' angles at the vertex.
std::vector<Eigen::Vector3f> vertex_normals(const TriangleSurface& surface);

/// The enclosed volume in steps^3, exact up to 2^53.
double enclosed_volume(const TriangleSurface& surface);

}  // namespace trocar
