// SPDX-License-Identifier: GPL-3.0-or-later
// The rim of a cavity as seen from a new point: the triangles of its edges and the point, four at a
// time and without branches, as whether one of them is bad cannot be predicted. Refinement spends
// most of its time here. Nearly all rims lie within kRimReach of the place for which the cavity was
// found, so that coordinates have 16 bits and products of two pairs of them are one instruction.
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

// GCC's and clang's vector types: operations apply to all elements. The elements of a mask are -1
// or 0.
using Four = std::int32_t __attribute__((vector_size(16)));
using FourReal = float __attribute__((vector_size(16)));
/// Of four points: x and y in turn.
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
/// One bit for each element of a mask.
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
/// Of the sum of masks.
inline int count_of(Four mask) {
  return -(mask[0] + mask[1] + mask[2] + mask[3]);
}

/// Of each of four pairs of vectors: the product, exact below 2^15.
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
/// Two numbers of two points each with 16 bits: the nearest where they are too large.
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
/// Two points, from an origin.
[[gnu::always_inline]] inline Four from_origin(LatticePoint p, LatticePoint q,
                                               LatticePoint origin) {
  using Two = std::int64_t __attribute__((vector_size(16)));
  return reinterpret_cast<Four>(
             Two{std::bit_cast<std::int64_t>(p), std::bit_cast<std::int64_t>(q)}) -
         Four{origin.x, origin.y, origin.x, origin.y};
}
/// Each vector (x, y) turned to (y, -x).
[[gnu::always_inline]] inline FourPoints turned(FourPoints p) {
  const FourPoints sign{0, -1, 0, -1, 0, -1, 0, -1};
  return (__builtin_shufflevector(p, p, 1, 0, 3, 2, 5, 4, 7, 6) ^ sign) - sign;
}

/// In lattice steps, along each axis. Sums of two products of differences of such points stay below
/// 2^30.
inline constexpr std::int32_t kRimReach = 1 << 13;

/// Of four points from an origin: a mask of those that do not lie within kRimReach of it.
inline Four is_beyond_rim_reach(FourPoints p) {
  using Unsigned = std::uint16_t __attribute__((vector_size(16)));
  constexpr std::uint16_t kReach = kRimReach;
  const Unsigned reach{kReach, kReach, kReach, kReach, kReach, kReach, kReach, kReach};
  return reinterpret_cast<Four>((reinterpret_cast<Unsigned>(p) + reach) >> 14) != 0;
}
/// The point numbered k of the four, four times.
[[gnu::always_inline]] inline FourPoints four_times(FourPoints p, std::size_t k) {
  return reinterpret_cast<FourPoints>(four_of(reinterpret_cast<Four>(p)[k]));
}

/// Four edges ab of a rim. Where fewer are left, the last one is repeated.
struct RimQuad {
  FourPoints a, b;  ///< from the cavity's origin, if the cavity is within kRimReach
  Four is_edge;     ///< not for the copies
  Four is_outline;
  /// Where an edge is split: does this one end where the former starts, or start where it ends?
  Four is_before, is_after;
  Four is_bad;  ///< of the triangles with the new point; filled in by the Refiner, as is_blocked
  /// Edges of the outline that the point encroaches upon or lies beyond; where an edge is split,
  /// those that are encroached then, its halves included.
  Four is_blocked;
};

/// The triangles abp.
struct RimView {
  Four doubled_area, pa2, pb2;
  Four at_p, at_a, at_b;  ///< the products of the edges that meet there: negative for obtuse angles

  Four ab2() const { return at_a + at_b; }
};

/// What makes a triangle bad, see ShapeLimits.
struct RimLimits {
  FourReal surely_sharp, perhaps_sharp;  ///< bounds on the smallest angle's squared sine
  Four doubled_area;

  RimLimits() = default;
  RimLimits(double sine2, double largest_doubled_area)
      : surely_sharp(four_of(static_cast<float>(sine2 * (1 - kRounding)))),
        perhaps_sharp(four_of(static_cast<float>(sine2 * (1 + kRounding)))),
        doubled_area(four_of(static_cast<std::int32_t>(std::min(largest_doubled_area, 0x1p30)))) {}

 private:
  // More than eight roundings of a float.
  static constexpr double kRounding = 0x1p-20;
};

/// From the same origin, all within kRimReach. Exact.
[[gnu::always_inline]] inline RimView rim_view(FourPoints from, FourPoints to, FourPoints p) {
  const FourPoints a = from - p, b = to - p;
  const Four pa2 = dots(a, a), pb2 = dots(b, b), dot = dots(a, b);
  return {dots(a, turned(b)), pa2, pb2, dot, pa2 - dot, pb2 - dot};
}

/// As TriangleShape::is_sharp, as far as that can be told with floats.
struct Sharpness {
  Four is_sharp, is_unsure;
};
[[gnu::always_inline]] inline Sharpness sharpness(const RimView& v, const RimLimits& limits) {
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
