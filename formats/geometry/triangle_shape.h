// SPDX-License-Identifier: Apache-2.0
// Measures of a counter-clockwise triangle. From them, mesh refinement decides whether to improve
// the triangle. Squared lengths and areas are computed as exact integers.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

#include "formats/geometry/lattice.h"

namespace trocar {

using TriangleCorners = std::array<LatticePoint, 3>;

inline double edge_length(LatticePoint a, LatticePoint b) noexcept {
  return std::sqrt(static_cast<double>(distance2(a, b)));
}

/// Number of the shortest edge (0 to 2, as in triangle_edge.h) and its squared length. If several
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
