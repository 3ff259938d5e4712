// SPDX-License-Identifier: GPL-3.0-or-later
// Measures the triangles between a new point and the edges of its cavity's boundary, four triangles
// at a time. (A cavity is the set of triangles that the insertion of the point replaces.)
// Refinement spends most of its time in these functions. They have no branches, because a processor
// cannot predict whether a triangle violates the limits of shape (is bad), and each wrong
// prediction costs time. Nearly always, the whole boundary lies within kMaxBoundaryOffset of the
// point for which the cavity was found. Coordinates relative to this point then fit into 16 bits,
// and one instruction computes four dot products.
#pragma once

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>
#ifdef __SSE2__
#include <emmintrin.h>
#endif

#include "formats/geometry/lattice.h"

namespace trocar::pipeline {

// Vectors of four numbers, an extension of GCC and clang. Each operation applies to all elements. A
// mask is a Four whose elements are -1 (true) or 0 (false).
using Four = std::int32_t __attribute__((vector_size(16)));
using FourReal = float __attribute__((vector_size(16)));
/// The coordinates of four points: x0, y0, x1, y1, ...
using FourPoints = std::int16_t __attribute__((vector_size(16)));

inline Four four_of(std::int32_t x) {
  return Four{x, x, x, x};
}
inline FourReal four_of(float x) {
  return FourReal{x, x, x, x};
}
inline FourReal larger(FourReal a, FourReal b) {
  return a < b ? b : a;
}
/// Returns a mask as a number: bit k (0 to 3) is 1 if element k of the mask is true.
inline unsigned bits_of(Four mask) {
#ifdef __SSE2__
  return static_cast<unsigned>(_mm_movemask_ps(reinterpret_cast<__m128>(mask)));
#else
  return static_cast<unsigned>((mask[0] & 1) | (mask[1] & 2) | (mask[2] & 4) | (mask[3] & 8));
#endif
}
inline bool is_any(Four mask) {
  return bits_of(mask) != 0;
}
/// The number of true elements in a mask. If `mask` is the sum of several masks, the total number
/// in all of them.
inline int count_of(Four mask) {
  return -(mask[0] + mask[1] + mask[2] + mask[3]);
}

/// The dot products of four pairs of vectors; exact if all |coordinates| are below 2^15.
[[gnu::always_inline]] inline Four dots(FourPoints a, FourPoints b) {
#ifdef __SSE2__
  return reinterpret_cast<Four>(
      _mm_madd_epi16(reinterpret_cast<__m128i>(a), reinterpret_cast<__m128i>(b)));
#else
  Four out{};
  for (std::size_t k = 0; k < 4; ++k)
    out[k] = a[2 * k] * b[2 * k] + a[2 * k + 1] * b[2 * k + 1];
  return out;
#endif
}
/// Four points with 16-bit coordinates, made of two pairs of points with 32-bit coordinates.
/// Coordinates that do not fit are clamped.
[[gnu::always_inline]] inline FourPoints narrowed(Four low, Four high) {
#ifdef __SSE2__
  return reinterpret_cast<FourPoints>(
      _mm_packs_epi32(reinterpret_cast<__m128i>(low), reinterpret_cast<__m128i>(high)));
#else
  FourPoints out{};
  for (std::size_t k = 0; k < 4; ++k) {
    out[k] = static_cast<std::int16_t>(std::clamp(low[k], -32768, 32767));
    out[k + 4] = static_cast<std::int16_t>(std::clamp(high[k], -32768, 32767));
  }
  return out;
#endif
}
/// Returns p and q relative to the origin.
[[gnu::always_inline]] inline Four from_origin(LatticePoint p, LatticePoint q,
                                               LatticePoint origin) {
  using Two = std::int64_t __attribute__((vector_size(16)));
  return reinterpret_cast<Four>(
             Two{std::bit_cast<std::int64_t>(p), std::bit_cast<std::int64_t>(q)}) -
         Four{origin.x, origin.y, origin.x, origin.y};
}
/// Turns each vector (x, y) to (y, -x).
[[gnu::always_inline]] inline FourPoints turned(FourPoints p) {
  const FourPoints sign{0, -1, 0, -1, 0, -1, 0, -1};
  return (__builtin_shufflevector(p, p, 1, 0, 3, 2, 5, 4, 7, 6) ^ sign) - sign;
}

/// The 16-bit measures are used only if no point is farther than this from the origin along an
/// axis, in lattice steps. The coordinates of two points within this distance differ by at most
/// 2^14, so dot products of such differences are below 2^30.
inline constexpr std::int32_t kMaxBoundaryOffset = 1 << 13;

/// Returns a mask of the points that are farther than kMaxBoundaryOffset from the origin
/// along an axis.
inline Four is_beyond_max_offset(FourPoints p) {
  using Unsigned = std::uint16_t __attribute__((vector_size(16)));
  constexpr std::uint16_t kMaxDifference = kMaxBoundaryOffset;
  const Unsigned reach{kMaxDifference, kMaxDifference, kMaxDifference, kMaxDifference,
                       kMaxDifference, kMaxDifference, kMaxDifference, kMaxDifference};
  return reinterpret_cast<Four>((reinterpret_cast<Unsigned>(p) + reach) >> 14) != 0;
}
/// Point k of the four, repeated four times.
[[gnu::always_inline]] inline FourPoints four_times(FourPoints p, std::size_t k) {
  return reinterpret_cast<FourPoints>(four_of(reinterpret_cast<Four>(p)[k]));
}

/// Four edges ab of a cavity's boundary. If fewer than four edges remain for the last quad, copies
/// of the last edge fill it.
struct BoundaryQuad {
  FourPoints a, b;  ///< relative to the cavity's origin; valid if InsertionCavity::is_near_origin()
  Four is_edge;     ///< false for the copies that fill the last quad
  Four is_outline;  ///< the edge is on the outline
  /// Valid if the new point splits an edge of the outline. `is_before` marks the edge that ends
  /// where the split edge starts, and `is_after` the edge that starts where the split edge ends.
  Four is_before, is_after;
  Four is_bad;  ///< the triangle of the edge and the new point is bad; set by InsertionTrial
  /// Set by InsertionTrial. If the new point lies in the material, this marks an edge of the
  /// outline that the point encroaches upon or lies beyond. If the new point splits an edge, this
  /// marks two kinds of edges: edges of the outline that are encroached upon after the split, and
  /// neighbours of a half of the split edge if that half is encroached upon.
  Four is_blocked;
};

/// Measures of four triangles abp. Each triangle has an edge ab of a cavity's boundary and a point
/// p. The measures are exact if all points are within kMaxBoundaryOffset of their common origin.
struct BoundaryTriangles {
  Four doubled_area, pa2, pb2;  ///< pa2 and pb2 are the squared lengths of the edges pa and pb
  Four at_p, at_a, at_b;        ///< dot product of a corner's two edges; negative: obtuse angle

  Four ab2() const { return at_a + at_b; }
};

/// ShapeLimits for four triangles at a time. A triangle beyond one of the limits is bad; it is
/// sharp if its smallest angle is below the limit on angles.
struct QuickShapeLimits {
  /// Limits on the squared sine of the smallest angle. If the value is below `surely_sharp`, the
  /// triangle is sharp. If it is above `perhaps_sharp`, the triangle is not sharp. In between,
  /// floats are too inaccurate to decide.
  FourReal surely_sharp, perhaps_sharp;
  Four doubled_area;  ///< largest doubled area allowed

  QuickShapeLimits(double sine2, double largest_doubled_area)
      : surely_sharp(four_of(static_cast<float>(sine2 * (1 - kRounding)))),
        perhaps_sharp(four_of(static_cast<float>(sine2 * (1 + kRounding)))),
        doubled_area(four_of(static_cast<std::int32_t>(std::min(largest_doubled_area, 0x1p30)))) {}

 private:
  // Upper bound on the relative error of eight rounded float operations.
  static constexpr double kRounding = 0x1p-20;
};

/// Measures the four triangles of the points from[k], to[k] and p[k]. Precondition: all points are
/// relative to the same origin and within kMaxBoundaryOffset of it.
[[gnu::always_inline]] inline BoundaryTriangles boundary_triangles(FourPoints from, FourPoints to,
                                                                   FourPoints p) {
  const FourPoints a = from - p, b = to - p;
  const Four pa2 = dots(a, a), pb2 = dots(b, b), dot = dots(a, b);
  return {dots(a, turned(b)), pa2, pb2, dot, pa2 - dot, pb2 - dot};
}

/// Evaluates TriangleShape::is_sharp for four triangles, as far as floats can decide it.
/// `is_unsure` marks the undecided triangles.
struct Sharpness {
  Four is_sharp, is_unsure;
};
[[gnu::always_inline]] inline Sharpness sharpness(const BoundaryTriangles& v,
                                                  const QuickShapeLimits& limits) {
  const auto real = [](Four x) { return __builtin_convertvector(x, FourReal); };
  const FourReal area = real(v.doubled_area), pa2 = real(v.pa2), pb2 = real(v.pb2),
                 ab2 = real(v.ab2());
  const FourReal product = larger(larger(ab2 * pa2, pa2 * pb2), pb2 * ab2);
  const FourReal area2 = area * area;
  const Four is_sharp = area2 < limits.surely_sharp * product,
             is_perhaps = area2 < limits.perhaps_sharp * product;
  return {is_sharp, is_sharp ^ is_perhaps};
}

}  // namespace trocar::pipeline
