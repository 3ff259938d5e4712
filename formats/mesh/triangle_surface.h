// SPDX-License-Identifier: Apache-2.0
// A closed surface of triangles in space, on an integer lattice, for display.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <utility>
#include <vector>

#include "formats/base/result.h"
#include "formats/mesh/lattice.h"

namespace trocar {

/// A point in space, lattice steps.
using SpacePoint = std::array<std::int32_t, 3>;

/// Largest admissible |coordinate|. Up to this limit a float32 holds every coordinate exactly, and
/// no product in the functions below overflows.
inline constexpr std::int32_t kMaxSpaceCoordinate = 1 << 24;

/// The corners of a triangle are counter-clockwise, seen from outside the material.
struct TriangleSurface {
  Lattice lattice;
  std::vector<SpacePoint> vertices;
  std::vector<std::array<std::uint32_t, 3>> triangles;
};

/// The corners of the smallest box around the points, the lower one first. Precondition: there is at
/// least one point.
std::pair<SpacePoint, SpacePoint> box_around(const std::vector<SpacePoint>& points);

/// Checks that a surface has these properties; the first two are proved in exact integers:
///  - all coordinates are admissible, all indices are in range, every vertex is used, and no
///    triangle has area 0;
///  - the surface is closed, manifold and oriented: each edge has two triangles, which traverse the
///    edge in opposite directions, and the triangles at a vertex form one closed fan, in which each
///    triangle shares an edge with the next;
///  - the surface encloses a positive volume, so it is not inside out.
/// Self-intersections are not detected. O(n log n). Errors: kRefused if a property is violated. For
/// the first two properties the message names a vertex or a triangle.
Result<void> check_triangle_surface(const TriangleSurface& surface);

/// The normal at each vertex: the mean of the unit normals of the triangles at the vertex, weighted
/// by the triangles' angles there.
std::vector<Eigen::Vector3f> vertex_normals(const TriangleSurface& surface);

/// The enclosed volume in steps^3. It is exact as long as all sums are below 2^53.
double enclosed_volume(const TriangleSurface& surface);

}  // namespace trocar
