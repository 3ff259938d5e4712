// SPDX-License-Identifier: Apache-2.0
// A turn of the plane by right angles that points themselves decide, so that what is done in the
// order that they have after it is done alike however they came: moved, turned or listed.
#pragma once

#include <algorithm>
#include <cstdint>

#include "formats/lattice.h"

namespace trocar::runtime {

/// Brings the mean of the points to the right of the middle of their box, above it or at its
/// height. None where the two are one point, as they are wherever a quarter or half turn brings the
/// points onto themselves.
class OwnTurn {
 public:
  void add(LatticePoint p) noexcept {
    low_ = {std::min(low_.x, p.x), std::min(low_.y, p.y)};
    high_ = {std::max(high_.x, p.x), std::max(high_.y, p.y)};
    sum_x_ += p.x;
    sum_y_ += p.y;
    ++count_;
  }
  /// After the last of them.
  void decide() noexcept {
    if (count_ == 0) return;
    const std::int64_t x = 2 * sum_x_ - count_ * (std::int64_t{low_.x} + high_.x);
    const std::int64_t y = 2 * sum_y_ - count_ * (std::int64_t{low_.y} + high_.y);
    quarters_ = x > 0 && y >= 0 ? 0 : y > 0 && x <= 0 ? 3 : x < 0 && y <= 0 ? 2 : y < 0 ? 1 : 0;
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

  LatticePoint low_{INT32_MAX, INT32_MAX}, high_{INT32_MIN, INT32_MIN};
  std::int64_t sum_x_ = 0, sum_y_ = 0, count_ = 0;
  int quarters_ = 0;
};

}  // namespace trocar::runtime
