// SPDX-License-Identifier: Apache-2.0
// Exact predicates and measures of a mesh's edges and triangles.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

#include "formats/mesh/lattice.h"
#include "formats/mesh/slice_mesh.h"

namespace trocar {

// Exact predicates on the edges of a mesh: where a point lies with respect to an edge ab, and
// whether an edge is Delaunay.

/// Returns true if p lies in the interior of the segment ab.
inline bool is_inside_segment(LatticePoint a, LatticePoint b, LatticePoint p) noexcept {
  return orient2d(a, b, p) == 0 && diametral_dot(a, b, p) < 0;
}

/// Returns true if p lies on the segment ab, its ends included.
inline bool is_on_segment(LatticePoint a, LatticePoint b, LatticePoint p) noexcept {
  return orient2d(a, b, p) == 0 && diametral_dot(a, b, p) <= 0;
}

/// Returns true if p encroaches upon the edge ab, which means that p lies strictly inside the
/// circle whose diameter is ab. In a triangle abp this means that the angle opposite ab is
/// above 90 degrees.
inline bool encroaches(LatticePoint a, LatticePoint b, LatticePoint p) noexcept {
  return diametral_dot(a, b, p) < 0;
}

/// Returns true if the boundary edge ab, with the material on its left, forbids a new vertex p. The
/// edge forbids p if p encroaches upon ab, or if p does not lie strictly on the left of ab.
inline bool blocks(LatticePoint a, LatticePoint b, LatticePoint p) noexcept {
  return diametral_dot(a, b, p) < 0 || orient2d(a, b, p) <= 0;
}

/// Returns true if the edge ab of the counter-clockwise triangle abc may be split at m. This is the
/// case if m lies on ab or on the inner side of ab, and strictly on the inner side of the other two
/// edges. Such a split never moves the boundary outwards, so the boundary cannot cross itself at m.
inline bool may_split(LatticePoint a, LatticePoint b, LatticePoint c, LatticePoint m) noexcept {
  return (orient2d(a, b, m) >= 0) & (orient2d(b, c, m) > 0) & (orient2d(c, a, m) > 0);
}

/// Returns true if the edge bc between the triangles abc and dcb is locally Delaunay. This is the
/// case if the sum of the two angles opposite bc is at most 180 degrees, which means that the sine
/// of the sum is at least 0. The function computes this sine times the lengths of the other four
/// edges. The product equals the determinant in in_circle() with the opposite sign, and takes fewer
/// multiplications. The code has no branches, because a processor cannot predict the result.
inline bool is_locally_delaunay(LatticePoint a, LatticePoint b, LatticePoint c,
                                LatticePoint d) noexcept {
  return Int128{orient2d(a, b, c)} * diametral_dot(b, c, d) +
             Int128{orient2d(d, c, b)} * diametral_dot(b, c, a) >=
         0;
}

// The numbering of a triangle's edges, the same in every mesh:
//
//   Edge i of a triangle runs from corner i to corner i + 1 (mod 3). The triangle lies on the left
//   of the edge. Corner i + 2 (mod 3), the apex, lies opposite the edge.
//
//            2
//           / \                     Triangle corners are counter-clockwise, so the triangle beyond
//   edge 2 /   \ edge 1             an edge has the same two vertices in the opposite order.
//         0-----1
//          edge 0

/// next_corner(i) is (i + 1) mod 3 and previous_corner(i) is (i + 2) mod 3, for corners and edges.
/// A table of two-bit digits avoids a branch that a processor cannot predict.
constexpr std::uint32_t next_corner(std::uint32_t i) noexcept {
  return (0b00'10'01U >> (2 * i)) & 3;
}
constexpr std::uint32_t previous_corner(std::uint32_t i) noexcept {
  return (0b01'00'10U >> (2 * i)) & 3;
}

/// The number of the triangle's corner at vertex v. The triangle's edge that starts at v has the
/// same number. Precondition: v is a vertex of the triangle.
constexpr std::uint32_t corner_of(const Triangle& triangle, std::uint32_t v) noexcept {
  return triangle[0] == v ? 0 : triangle[1] == v ? 1 : 2;
}

/// One edge of one triangle.
struct TriangleEdge {
  std::uint32_t triangle, edge;
};

/// A TriangleEdge as one number. Triangle numbers must be below 2^29. kNoEdge stands for no edge.
using EdgeId = std::uint32_t;
inline constexpr EdgeId kNoEdge = 0xffffffff;
constexpr EdgeId edge_id(std::uint32_t triangle, std::uint32_t edge) noexcept {
  return 4 * triangle + edge;
}
constexpr std::uint32_t triangle_of(EdgeId e) noexcept {
  return e >> 2;
}
constexpr std::uint32_t index_of(EdgeId e) noexcept {
  return e & 3;
}

// Measures of a counter-clockwise triangle. From them, mesh refinement decides whether to improve
// the triangle. Squared lengths and areas are computed as exact integers.

using TriangleCorners = std::array<LatticePoint, 3>;

inline double edge_length(LatticePoint a, LatticePoint b) noexcept {
  return std::sqrt(static_cast<double>(distance2(a, b)));
}

/// Number of the shortest edge (0 to 2, as above) and its squared length. If several
/// edges are equally short, the first one counts.
struct ShortestEdge {
  std::uint32_t edge;
  std::int64_t length2;
};
inline ShortestEdge shortest_edge(const TriangleCorners& v) noexcept {
  const std::array<std::int64_t, 3> d{distance2(v[0], v[1]), distance2(v[1], v[2]),
                                      distance2(v[2], v[0])};
  // This is free of branches because a processor cannot predict the result.
  const std::uint32_t is_second = d[1] < d[0] ? 1 : 0,
                      is_third = ((d[2] < d[0]) & (d[2] < d[1])) ? 1 : 0;
  const std::uint32_t edge = (is_second & (is_third ^ 1)) | is_third << 1;
  return {edge, d[edge]};
}

inline double circumradius2(const TriangleCorners& v) noexcept {
  const auto doubled_area = static_cast<double>(orient2d(v[0], v[1], v[2]));
  return static_cast<double>(distance2(v[0], v[1])) * static_cast<double>(distance2(v[1], v[2])) *
         static_cast<double>(distance2(v[2], v[0])) / (4 * doubled_area * doubled_area);
}

struct ShapeLimits {
  double sine2;         ///< squared sine of the smallest angle allowed
  double doubled_area;  ///< largest doubled area allowed, steps^2
};

struct TriangleShape {
  std::int64_t doubled_area;
  double shortest2;  ///< squared length of the shortest edge
  bool is_sharp;     ///< the triangle's smallest angle is below the limit
  bool is_large;     ///< the area is above the largest area allowed
  bool is_bad() const noexcept { return is_sharp | is_large; }
};

/// The shape of the triangle abc. This is the mesher's innermost function, so it is free of
/// branches.
[[gnu::always_inline]] inline TriangleShape shape_of(LatticePoint a, LatticePoint b, LatticePoint c,
                                                     const ShapeLimits& limits) noexcept {
  const std::int64_t ab_x = std::int64_t{b.x} - a.x, ab_y = std::int64_t{b.y} - a.y;
  const std::int64_t ac_x = std::int64_t{c.x} - a.x, ac_y = std::int64_t{c.y} - a.y;
  const std::int64_t bc_x = ac_x - ab_x, bc_y = ac_y - ab_y;
  const std::int64_t doubled_area = ab_x * ac_y - ab_y * ac_x;
  const auto ab2 = static_cast<double>(ab_x * ab_x + ab_y * ab_y),
             ac2 = static_cast<double>(ac_x * ac_x + ac_y * ac_y),
             bc2 = static_cast<double>(bc_x * bc_x + bc_y * bc_y);
  // The smallest angle lies between the two longer edges, l and m: its sine is
  // doubled_area / (l m).
  const double product = std::max(std::max(ab2 * ac2, ac2 * bc2), bc2 * ab2);
  const auto area = static_cast<double>(doubled_area);
  return {doubled_area, std::min(std::min(ab2, ac2), bc2),
          area * area<limits.sine2 * product, area> limits.doubled_area};
}

/// Returns true if the smallest angle is below the angle whose squared cosine is `cos2`. An
/// infinite `cos2` means that there is no limit, so the function returns false. Close to the limit,
/// rounding may make the result differ from TriangleShape::is_sharp.
inline bool is_angle_below_cosine(const TriangleCorners& v, double cos2) noexcept {
  // The smallest angle lies opposite the shortest edge, between the two others. s, l and m are the
  // squared lengths of these edges, so the scalar product of the two others is (l + m - s) / 2.
  const auto [edge, s] = shortest_edge(v);
  const std::int64_t l = distance2(v[(edge + 1) % 3], v[(edge + 2) % 3]),
                     m = distance2(v[(edge + 2) % 3], v[edge]);
  const double dot = 0.5 * static_cast<double>(l + m - s);
  return dot * dot > cos2 * (static_cast<double>(l) * static_cast<double>(m));
}

}  // namespace trocar
