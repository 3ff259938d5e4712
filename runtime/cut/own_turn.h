// SPDX-License-Identifier: Apache-2.0
// A turn of the plane by right angles that points themselves decide, so that what is done in the
// order that they have after it is done alike however they came: moved, turned or listed.
#pragma once

#include <algorithm>
#include <cstdint>

#include "formats/geometry/lattice.h"

namespace trocar::runtime {

/// Of the vectors below the first that is not zero is brought to point right, and up or level: from
/// the middle of the points' box to their mean, and two third moments about that middle. All are
/// zero, and there is no turn, where a quarter or half turn brings the points onto themselves, and
/// hardly ever else. Exact.
class OwnTurn {
 public:
  OwnTurn() = default;
  /// `for_each(visit)` calls visit(point) for all points, alike each time.
  template <typename ForEach>
  explicit OwnTurn(const ForEach& for_each) {
    LatticePoint low{INT32_MAX, INT32_MAX}, high{INT32_MIN, INT32_MIN};
    for_each([&](LatticePoint p) {
      low = {std::min(low.x, p.x), std::min(low.y, p.y)};
      high = {std::max(high.x, p.x), std::max(high.y, p.y)};
    });
    if (low.x > high.x) return;
    // Twice the place relative to the middle.
    const auto x_of = [&](LatticePoint p) {
      return (std::int64_t{p.x} - low.x) - (std::int64_t{high.x} - p.x);
    };
    const auto y_of = [&](LatticePoint p) {
      return (std::int64_t{p.y} - low.y) - (std::int64_t{high.y} - p.y);
    };
    Int128 x1 = 0, y1 = 0;
    for_each([&](LatticePoint p) { x1 += x_of(p), y1 += y_of(p); });
    if (decide(x1, y1)) return;
    Int128 x3 = 0, y3 = 0, xyy = 0, yxx = 0;
    for_each([&](LatticePoint p) {
      const Int128 x = x_of(p), y = y_of(p);
      x3 += x * x * x, y3 += y * y * y, xyy += x * y * y, yxx += y * x * x;
    });
    if (!decide(x3, y3)) decide(xyy, yxx);
  }

  LatticePoint operator()(LatticePoint p) const noexcept { return turned(p, quarters_); }
  LatticePoint back(LatticePoint p) const noexcept { return turned(p, 4 - quarters_); }
  /// Likewise of a vector that is not on the lattice.
  template <typename Vector>
  Vector back(const Vector& v) const noexcept {
    Vector out = v;
    for (int i = quarters_; i % 4 != 0; ++i)
      out = {-out.y(), out.x()};
    return out;
  }
  /// Of a box's corners, 0..3 counter-clockwise from the lower left, the one that is the lower left
  /// after the turn.
  int lower_left() const noexcept { return (4 - quarters_) % 4; }

 private:
  bool decide(Int128 x, Int128 y) noexcept {
    quarters_ = x > 0 && y >= 0 ? 0 : y > 0 && x <= 0 ? 3 : x < 0 && y <= 0 ? 2 : y < 0 ? 1 : 0;
    return x != 0 || y != 0;
  }
  static LatticePoint turned(LatticePoint p, int quarters) noexcept {
    switch (quarters) {
      case 1:
        return {-p.y, p.x};
      case 2:
        return {-p.x, -p.y};
      case 3:
        return {p.y, -p.x};
      default:
        return p;
    }
  }

  int quarters_ = 0;
};

}  // namespace trocar::runtime
