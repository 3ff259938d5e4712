// SPDX-License-Identifier: Apache-2.0
// An axis-parallel box on the lattice.
#pragma once

#include <algorithm>
#include <span>

#include "formats/geometry/lattice.h"

namespace trocar {

struct LatticeBox {
  LatticePoint low, high;  ///< lower left and upper right corner; both belong to the box
};

/// Enlarges the box to hold the point.
inline void widen(LatticeBox& box, LatticePoint p) noexcept {
  box.low = {std::min(box.low.x, p.x), std::min(box.low.y, p.y)};
  box.high = {std::max(box.high.x, p.x), std::max(box.high.y, p.y)};
}
inline void widen(LatticeBox& box, std::span<const LatticePoint> points) noexcept {
  for (const LatticePoint p : points)
    widen(box, p);
}

/// The smallest box that holds all points. Precondition: there is at least one point.
inline LatticeBox box_around(std::span<const LatticePoint> points) noexcept {
  LatticeBox box{points[0], points[0]};
  widen(box, points);
  return box;
}

inline LatticeBox box_around(LatticePoint a, LatticePoint b) noexcept {
  return {{std::min(a.x, b.x), std::min(a.y, b.y)}, {std::max(a.x, b.x), std::max(a.y, b.y)}};
}

inline bool contains(const LatticeBox& outer, const LatticeBox& inner) noexcept {
  return outer.low.x <= inner.low.x && outer.low.y <= inner.low.y && outer.high.x >= inner.high.x &&
         outer.high.y >= inner.high.y;
}

/// Returns true if the boxes have no point in common.
inline bool apart(const LatticeBox& a, const LatticeBox& b) noexcept {
  // This is free of branches because a processor cannot predict the result.
  return (a.low.x > b.high.x) | (a.high.x < b.low.x) | (a.low.y > b.high.y) | (a.high.y < b.low.y);
}

}  // namespace trocar
