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

/// Largest admissible |coordinate|: a float32 holds it exactly, and no product overflows in the
/// functions below.
inline constexpr std::int32_t kMaxSpaceCoordinate = 1 << 24;

/// Triangles are counter-clockwise seen from outside the material.
struct TriangleSurface {
  Lattice lattice;
  std::vector<SpacePoint> vertices;
  std::vector<std::array<std::uint32_t, 3>> triangles;
};

/// Proves the following, or names the first vertex or triangle that violates it. The first two
/// properties are proved in exact integers.
///  - coordinates are admissible, indices in range, every vertex is used, no triangle has area 0;
///  - the surface is closed, manifold and oriented: each edge has two triangles, which traverse it
///    in opposite directions, and the triangles at a vertex form one fan, in which each triangle
///    shares an edge with the next;
///  - the surface encloses a positive volume, so it is not inside out.
/// The function does not detect self-intersections. O(n log n). Errors: kRefused if a
/// property is violated.
Result<void> check_triangle_surface(const TriangleSurface& surface);

/// The normal at each vertex: the mean of the unit normals of the triangles at the vertex, weighted
/// by the triangles' angles there.
std::vector<Eigen::Vector3f> vertex_normals(const TriangleSurface& surface);

/// The enclosed volume in steps^3. It is exact as long as all sums are below 2^53.
double enclosed_volume(const TriangleSurface& surface);

}  // namespace trocar
