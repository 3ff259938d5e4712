// SPDX-License-Identifier: Apache-2.0
// What refinement asks of a counter-clockwise triangle's shape. Lengths are exact, what follows
// from them is rounded once or twice.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>

#include "formats/geometry/lattice.h"

namespace trocar::runtime {

using Corners = std::array<LatticePoint, 3>;

inline double side_length(LatticePoint a, LatticePoint b) noexcept {
  return std::sqrt(static_cast<double>(distance2(a, b)));
}

/// Of the shortest side: its number (from that corner to the next) and squared length.
struct ShortestSide {
  std::uint32_t side;
  std::int64_t length2;
};
inline ShortestSide shortest_side(const Corners& v) noexcept {
  const std::array<std::int64_t, 3> d{distance2(v[0], v[1]), distance2(v[1], v[2]),
                                      distance2(v[2], v[0])};
  const std::uint32_t side = d[0] <= d[1] && d[0] <= d[2] ? 0 : d[1] <= d[2] ? 1 : 2;
  return {side, d[side]};
}

/// Is the smallest angle below the one whose squared cosine is given?
inline bool is_sharp(const Corners& v, double cos2) noexcept {
  // It lies opposite the shortest side s, between l and m: l.m = (l^2 + m^2 - s^2) / 2.
  const auto [side, s] = shortest_side(v);
  const std::int64_t l = distance2(v[(side + 1) % 3], v[(side + 2) % 3]),
                     m = distance2(v[(side + 2) % 3], v[side]);
  const double dot = 0.5 * static_cast<double>(l + m - s);
  return dot * dot > cos2 * (static_cast<double>(l) * static_cast<double>(m));
}

inline double circumradius2(const Corners& v) noexcept {
  const auto doubled_area = static_cast<double>(orient2d(v[0], v[1], v[2]));
  return static_cast<double>(distance2(v[0], v[1])) * static_cast<double>(distance2(v[1], v[2])) *
         static_cast<double>(distance2(v[2], v[0])) / (4 * doubled_area * doubled_area);
}

}  // namespace trocar::runtime
