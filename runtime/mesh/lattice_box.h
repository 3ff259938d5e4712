// SPDX-License-Identifier: Apache-2.0
// An axis-parallel box on the lattice.
#pragma once

#include <algorithm>
#include <span>

#include "formats/geometry/lattice.h"

namespace trocar::runtime {

struct LatticeBox {
  LatticePoint lowest, highest;  ///< both inclusive
};

/// The smallest box around the points, of which there is at least one.
inline LatticeBox box_around(std::span<const LatticePoint> points) noexcept {
  LatticeBox box{points[0], points[0]};
  for (const LatticePoint p : points) {
    box.lowest = {std::min(box.lowest.x, p.x), std::min(box.lowest.y, p.y)};
    box.highest = {std::max(box.highest.x, p.x), std::max(box.highest.y, p.y)};
  }
  return box;
}

inline LatticeBox box_around(LatticePoint a, LatticePoint b) noexcept {
  return {{std::min(a.x, b.x), std::min(a.y, b.y)}, {std::max(a.x, b.x), std::max(a.y, b.y)}};
}

inline bool contains(const LatticeBox& outer, const LatticeBox& inner) noexcept {
  return outer.lowest.x <= inner.lowest.x && outer.lowest.y <= inner.lowest.y &&
         outer.highest.x >= inner.highest.x && outer.highest.y >= inner.highest.y;
}

inline bool apart(const LatticeBox& a, const LatticeBox& b) noexcept {
  return a.lowest.x > b.highest.x || a.highest.x < b.lowest.x || a.lowest.y > b.highest.y ||
         a.highest.y < b.lowest.y;
}

}  // namespace trocar::runtime
