// SPDX-License-Identifier: Apache-2.0
// The rotation of the plane by right angles that brings a set of points into a canonical (fixed)
// orientation. Some decisions of the mesh operations depend on the order of points, on ties or on
// rounding; these decisions are made in the rotated plane. So if an outline is translated by whole
// lattice steps or rotated by right angles, its mesh is translated and rotated with the outline,
// and is otherwise the same.
#pragma once

#include <cstdint>
#include <span>

#include "formats/mesh/lattice.h"
#include "formats/mesh/slice_mesh.h"

namespace trocar {

/// A counter-clockwise rotation about the origin by a multiple of 90 degrees.
class CanonicalRotation {
 public:
  CanonicalRotation() = default;
  /// The rotation that turns the vector (x, y) so that x > 0 and y >= 0; the identity for (0, 0).
  template <typename Number>
  static CanonicalRotation of(Number x, Number y) noexcept {
    CanonicalRotation out;
    out.quarters_ = x > 0 && y >= 0 ? 0 : y > 0 && x <= 0 ? 3 : x < 0 && y <= 0 ? 2 : y < 0 ? 1 : 0;
    return out;
  }

  bool is_identity() const noexcept { return quarters_ == 0; }
  LatticePoint operator()(LatticePoint p) const noexcept { return rotated(p, quarters_); }
  /// The inverse rotation.
  LatticePoint back(LatticePoint p) const noexcept { return rotated(p, 4 - quarters_); }
  /// The inverse rotation of a vector, whose x() and y() need not be whole numbers.
  template <typename Vector>
  Vector back(const Vector& v) const noexcept {
    Vector out = v;
    for (int i = quarters_; i % 4 != 0; ++i)
      out = {-out.y(), out.x()};
    return out;
  }
  /// Number of the corner of a box that the rotation moves to the lower left. Corners are numbered
  /// 0..3 counter-clockwise from the lower left.
  int lower_left() const noexcept { return (4 - quarters_) % 4; }

 private:
  static LatticePoint rotated(LatticePoint p, int quarters) noexcept {
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

  int quarters_ = 0;  // 0 .. 3
};

/// A vector that turns with a set of points and so determines a canonical orientation: 2 n (m - c),
/// where n is the number of points, m their mean, and c the centre of the box around them. The
/// vector is exact. It depends neither on the order of the points nor on a translation of all
/// points together.
class CentroidOffset {
 public:
  void add(LatticePoint p) noexcept {
    widen(box_, p);
    sum_x_ += p.x;
    sum_y_ += p.y;
    ++count_;
  }
  std::int64_t x() const noexcept {
    return 2 * sum_x_ - count_ * (std::int64_t{box_.low.x} + box_.high.x);
  }
  std::int64_t y() const noexcept {
    return 2 * sum_y_ - count_ * (std::int64_t{box_.low.y} + box_.high.y);
  }
  const LatticeBox& box() const noexcept { return box_; }

 private:
  LatticeBox box_{{INT32_MAX, INT32_MAX}, {INT32_MIN, INT32_MIN}};
  std::int64_t sum_x_ = 0, sum_y_ = 0, count_ = 0;
};

/// Returns the rotation after which the points' CentroidOffset has x > 0 and y >= 0. If the offset
/// is zero, the result is the identity. The offset is zero, for example, if a rotation by 90 or 180
/// degrees about the centre of the box maps the set of points onto itself.
inline CanonicalRotation rotation_by_centroid(std::span<const LatticePoint> points) noexcept {
  CentroidOffset offset;
  for (const LatticePoint p : points)
    offset.add(p);
  return CanonicalRotation::of(offset.x(), offset.y());
}
inline CanonicalRotation rotation_by_centroid(const Pslg& pslg) noexcept {
  CentroidOffset offset;
  for (const Ring& ring : pslg.rings) {
    for (const LatticePoint p : ring)
      offset.add(p);
  }
  return CanonicalRotation::of(offset.x(), offset.y());
}

/// Like rotation_by_centroid(), but uses the first of three vectors that is not zero: the points'
/// CentroidOffset, then (sum of x^3, sum of y^3), then (sum of x y^2, sum of y x^2). The sums run
/// over all points; x and y are a point's coordinates relative to the centre of the box. If all
/// three vectors are zero, the result is the identity. This case is rare, except for sets of points
/// that a rotation maps onto themselves. Exact. `for_each(visit)` must call visit(point) for all
/// points. rotation_by_moments() may call `for_each` twice; both calls must visit the same points.
template <typename ForEach>
CanonicalRotation rotation_by_moments(const ForEach& for_each) {
  CentroidOffset offset;
  for_each([&offset](LatticePoint p) { offset.add(p); });
  if (offset.x() != 0 || offset.y() != 0) return CanonicalRotation::of(offset.x(), offset.y());
  const LatticeBox box = offset.box();
  Int128 x3 = 0, y3 = 0, xyy = 0, yxx = 0;
  for_each([&](LatticePoint p) {
    // Twice the position relative to the centre.
    const Int128 x = (std::int64_t{p.x} - box.low.x) - (std::int64_t{box.high.x} - p.x);
    const Int128 y = (std::int64_t{p.y} - box.low.y) - (std::int64_t{box.high.y} - p.y);
    x3 += x * x * x, y3 += y * y * y, xyy += x * y * y, yxx += y * x * x;
  });
  return x3 != 0 || y3 != 0 ? CanonicalRotation::of(x3, y3) : CanonicalRotation::of(xyy, yxx);
}

}  // namespace trocar
