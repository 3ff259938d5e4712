// SPDX-License-Identifier: GPL-3.0-or-later
// A turn of the plane that an outline itself decides, so that what is done to it after that turn is
// done alike however the outline came: order of a sweep, ties, rounding to the lattice.
#pragma once

#include <cstdint>
#include <span>

#include "formats/geometry/slice_mesh.h"

namespace trocar::pipeline {

/// Counter-clockwise by so many right angles.
struct QuarterTurn {
  int quarters = 0;  ///< 0 .. 3

  LatticePoint operator()(LatticePoint p) const {
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
  QuarterTurn back() const { return {(4 - quarters) % 4}; }
};

/// Where points lie in their box: twice their number times (their mean less the box's middle).
/// Exact; their order, and moving all of them, does not matter.
class Lopsidedness {
 public:
  void add(LatticePoint p) {
    low_ = {p.x < low_.x ? p.x : low_.x, p.y < low_.y ? p.y : low_.y};
    high_ = {p.x > high_.x ? p.x : high_.x, p.y > high_.y ? p.y : high_.y};
    sum_x_ += p.x;
    sum_y_ += p.y;
    ++count_;
  }
  std::int64_t x() const { return 2 * sum_x_ - count_ * (std::int64_t{low_.x} + high_.x); }
  std::int64_t y() const { return 2 * sum_y_ - count_ * (std::int64_t{low_.y} + high_.y); }

  /// Turns the mean to the right of the box's middle, above or at its height. None if the two are
  /// one point, as they are wherever the points come onto themselves by a quarter or half turn.
  QuarterTurn turn() const {
    if (count_ == 0) return {};
    const std::int64_t dx = x(), dy = y();
    if (dx > 0 && dy >= 0) return {0};
    if (dy > 0 && dx <= 0) return {3};
    if (dx < 0 && dy <= 0) return {2};
    return {dy < 0 ? 1 : 0};
  }

 private:
  LatticePoint low_{INT32_MAX, INT32_MAX}, high_{INT32_MIN, INT32_MIN};
  std::int64_t sum_x_ = 0, sum_y_ = 0, count_ = 0;
};

inline QuarterTurn own_turn(const Pslg& pslg) {
  Lopsidedness sum;
  for (const Ring& ring : pslg.rings) {
    for (const LatticePoint p : ring)
      sum.add(p);
  }
  return sum.turn();
}
inline QuarterTurn own_turn(std::span<const LatticePoint> points) {
  Lopsidedness sum;
  for (const LatticePoint p : points)
    sum.add(p);
  return sum.turn();
}

}  // namespace trocar::pipeline
