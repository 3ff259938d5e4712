// SPDX-License-Identifier: Apache-2.0
// The integer lattice in the slice plane and the exact predicates on it. Every coordinate that is
// stored, or on which a decision of an algorithm depends, lies on the lattice.
//
// Laws:
//  1. orient2d(a,b,c) > 0 iff a,b,c turn counter-clockwise; 0 iff collinear;
//     it changes sign when two arguments are swapped.
//  2. in_circle(a,b,c,d) > 0 iff d lies strictly inside the circle through the
//     counter-clockwise triangle a,b,c; 0 iff the four are cocircular.
//  3. Both functions are exact for all coordinates with |x|,|y| <= kMaxCoordinate.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <bit>
#include <cmath>
#include <compare>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

namespace trocar {

/// A point of the slice plane in lattice steps.
struct LatticePoint {
  std::int32_t x = 0;
  std::int32_t y = 0;
  friend bool operator==(const LatticePoint&, const LatticePoint&) = default;
  // NOLINTNEXTLINE(modernize-use-nullptr): clang-tidy 14 takes the comparison with 0 for a pointer
  friend auto operator<=>(const LatticePoint&, const LatticePoint&) = default;
};

/// "lattice point (x, y)", for messages.
std::string to_text(LatticePoint p);

/// Largest admissible |coordinate|. With this limit, orient2d() fits into 64 bits and in_circle()
/// into 128 bits. Assets have a smaller limit: kMaxAssetCoordinate in asset.h.
inline constexpr std::int32_t kMaxCoordinate = 1 << 29;

/// Returns true if both coordinates are admissible.
inline bool is_on_lattice(LatticePoint p) {
  return p.x >= -kMaxCoordinate && p.x <= kMaxCoordinate && p.y >= -kMaxCoordinate &&
         p.y <= kMaxCoordinate;
}

/// A lattice with a step of 2^-bits mm.
struct Lattice {
  int bits = 8;
  double step_mm() const { return power_of_two(-bits); }
  double step_m() const { return step_mm() * 1e-3; }
  /// The lattice coordinate nearest to a coordinate in mm (ties to even). `mm` must be finite with
  /// |mm| / step <= kMaxCoordinate.
  std::int32_t snap_mm(double mm) const {
    // Beyond 2^52 a double has no fractional part, so the sum is rounded to a whole number.
    constexpr double kWhole = 0x1.8p52;
    return static_cast<std::int32_t>((mm * power_of_two(bits) + kWhole) - kWhole);
  }
  double to_mm(std::int64_t c) const { return static_cast<double>(c) * power_of_two(-bits); }
  friend bool operator==(const Lattice&, const Lattice&) = default;

 private:
  // std::ldexp(1, exponent) without a function call, for exponents of at least -1022. Products with
  // the result are exact.
  static double power_of_two(int exponent) {
    return std::bit_cast<double>(static_cast<std::uint64_t>(1023 + exponent) << 52);
  }
};
inline constexpr int kMinLatticeBits = 0;
inline constexpr int kMaxLatticeBits = 14;

__extension__ typedef __int128 Int128;

/// Twice the signed area of a,b,c. Exact.
inline std::int64_t orient2d(LatticePoint a, LatticePoint b, LatticePoint c) {
  return (std::int64_t{b.x} - a.x) * (std::int64_t{c.y} - a.y) -
         (std::int64_t{b.y} - a.y) * (std::int64_t{c.x} - a.x);
}

/// Sign of the in-circle determinant: 1, 0 or -1 (law 2). Exact.
inline int in_circle(LatticePoint a, LatticePoint b, LatticePoint c, LatticePoint d) {
  const std::int64_t adx = std::int64_t{a.x} - d.x, ady = std::int64_t{a.y} - d.y;
  const std::int64_t bdx = std::int64_t{b.x} - d.x, bdy = std::int64_t{b.y} - d.y;
  const std::int64_t cdx = std::int64_t{c.x} - d.x, cdy = std::int64_t{c.y} - d.y;
  const Int128 det = Int128{adx * adx + ady * ady} * (bdx * cdy - bdy * cdx) +
                     Int128{bdx * bdx + bdy * bdy} * (cdx * ady - cdy * adx) +
                     Int128{cdx * cdx + cdy * cdy} * (adx * bdy - ady * bdx);
  return det > 0 ? 1 : (det < 0 ? -1 : 0);
}

/// Squared distance in steps^2. Exact.
inline std::int64_t distance2(LatticePoint a, LatticePoint b) {
  const std::int64_t dx = std::int64_t{a.x} - b.x, dy = std::int64_t{a.y} - b.y;
  return dx * dx + dy * dy;
}

/// Returns the scalar product (a - p) . (b - p). It is negative iff p lies strictly inside the
/// circle whose diameter is ab, which means that p encroaches upon the segment ab. Exact.
inline std::int64_t diametral_dot(LatticePoint a, LatticePoint b, LatticePoint p) {
  return (std::int64_t{a.x} - p.x) * (std::int64_t{b.x} - p.x) +
         (std::int64_t{a.y} - p.y) * (std::int64_t{b.y} - p.y);
}

/// Returns true if the segments ab and cd have a common point, and this point lies inside at least
/// one of them (it is not an end of both). Segments that only share end points do not cross. Exact.
bool segments_cross(LatticePoint a, LatticePoint b, LatticePoint c, LatticePoint d);

// An axis-parallel box on the lattice.

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

// A grid of square cells over a box on the lattice.

struct LatticeCells {
  LatticePoint low{};  ///< lower left corner of the grid
  double size = 1;     ///< side length of a cell, lattice steps
  std::int32_t columns = 1, rows = 1;

  LatticeCells() = default;
  /// Divides the box into about `count` cells. The box may have no area. Precondition: `count` is
  /// at least 1.
  LatticeCells(const LatticeBox& box, double count) : low(box.low) {
    const double width = 1.0 + static_cast<double>(box.high.x) - box.low.x,
                 height = 1.0 + static_cast<double>(box.high.y) - box.low.y;
    size = std::max({1.0, std::sqrt(width * height / count), width / count, height / count});
    columns = 1 + static_cast<std::int32_t>(width / size);
    rows = 1 + static_cast<std::int32_t>(height / size);
  }
  std::size_t count() const {
    return static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows);
  }
};

// Differences of lattice points as floating-point vectors.

/// The vector from `origin` to `p` in lattice steps. It is exact, because a difference of two
/// 32-bit integers has 33 bits, and a double holds 53.
inline Eigen::Vector2d offset_in_steps(LatticePoint p, LatticePoint origin) noexcept {
  return {static_cast<double>(std::int64_t{p.x} - origin.x),
          static_cast<double>(std::int64_t{p.y} - origin.y)};
}

}  // namespace trocar
