// SPDX-License-Identifier: GPL-3.0-or-later
// Is a triangle too sharp or too large?
#pragma once

#include <algorithm>
#include <cstdint>

#include "formats/geometry/lattice.h"

namespace trocar::pipeline {

struct ShapeLimits {
  double sine2;         ///< of the wanted angle, squared
  double doubled_area;  ///< largest, in squared steps
};

/// A triangle's shape, as far as refinement cares.
struct Shape {
  std::int64_t doubled_area;
  double ca2;        ///< squared length of the side from c to a
  double shortest2;  ///< and of the shortest side
  bool is_sharp, is_large;
  bool is_bad() const { return is_sharp || is_large; }
};

/// Of the triangle abc. It is asked for more often than anything else, and free of branches.
[[gnu::always_inline]] inline Shape shape_of(LatticePoint a, LatticePoint b, LatticePoint c,
                                             const ShapeLimits& limits) {
  const std::int64_t ab_x = std::int64_t{b.x} - a.x, ab_y = std::int64_t{b.y} - a.y;
  const std::int64_t ac_x = std::int64_t{c.x} - a.x, ac_y = std::int64_t{c.y} - a.y;
  const std::int64_t bc_x = ac_x - ab_x, bc_y = ac_y - ab_y;
  const std::int64_t doubled_area = ab_x * ac_y - ab_y * ac_x;
  const auto ab2 = static_cast<double>(ab_x * ab_x + ab_y * ab_y),
             ac2 = static_cast<double>(ac_x * ac_x + ac_y * ac_y),
             bc2 = static_cast<double>(bc_x * bc_x + bc_y * bc_y);
  // The smallest angle lies between the two longer sides, l and m: its sine is doubled_area / l m.
  const double product = std::max(std::max(ab2 * ac2, ac2 * bc2), bc2 * ab2);
  const auto area = static_cast<double>(doubled_area);
  return {doubled_area, ac2, std::min(std::min(ab2, ac2), bc2),
          area * area<limits.sine2 * product, area> limits.doubled_area};
}

}  // namespace trocar::pipeline
