// SPDX-License-Identifier: GPL-3.0-or-later
// The rim of a cavity as seen from a new point: the triangles of its edges and the point, two at a
// time and without branches, as whether one of them is bad cannot be predicted. Refinement spends
// most of its time here.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>
#include <span>

#include "formats/geometry/lattice.h"

namespace trocar::pipeline {

/// Of two edges. (GCC's and clang's vector types: operations apply to both elements; the elements
/// of a mask are -1 or 0.)
using Pair = double __attribute__((vector_size(16)));
using PairMask = std::int64_t __attribute__((vector_size(16)));

inline Pair pair_of(double x) {
  return Pair{x, x};
}
inline bool is_any(PairMask m) {
  return (m[0] | m[1]) != 0;
}
/// Of the sum of masks.
inline int count_of(PairMask m) {
  return static_cast<int>(-(m[0] + m[1]));
}
inline Pair least(Pair a, Pair b) {
  return a < b ? a : b;
}
inline Pair largest(Pair a, Pair b) {
  return a < b ? b : a;
}

/// Two points, from an origin.
[[gnu::always_inline]] inline void set_pair(LatticePoint p, LatticePoint q, LatticePoint origin,
                                            Pair& x, Pair& y) {
  using Four = std::int32_t __attribute__((vector_size(16)));
  const Four both = std::bit_cast<Four>(
                        PairMask{std::bit_cast<std::int64_t>(p), std::bit_cast<std::int64_t>(q)}) -
                    Four{origin.x, origin.y, origin.x, origin.y};
  x = __builtin_convertvector((__builtin_shufflevector(both, both, 0, 2)), Pair);
  y = __builtin_convertvector((__builtin_shufflevector(both, both, 1, 3)), Pair);
}

/// Two edges ab of a rim, in steps from the cavity's origin. Where the number of edges is odd, the
/// last pair has the last edge twice.
struct RimPair {
  Pair ax, ay, bx, by;
  PairMask is_edge;     ///< not for the copy
  PairMask is_outline;  ///< nor here
  /// Where an edge is split: does this one end where the former starts, or start where it ends?
  PairMask is_before, is_after;
  /// Of the triangles with the new point; filled in by the Refiner.
  Pair shortest2;
  PairMask is_bad;
};

/// The triangles abp.
struct PairView {
  Pair doubled_area, pa2, pb2, ab2;
  Pair at_p, at_a, at_b;  ///< the products of the edges that meet there: negative for obtuse angles

  PairMask is_turned() const { return doubled_area <= pair_of(0); }
  Pair shortest2() const { return least(least(ab2, pa2), pb2); }
  /// As TriangleShape::is_sharp.
  PairMask is_sharp(Pair sine2) const {
    const Pair product = largest(largest(ab2 * pa2, pa2 * pb2), pb2 * ab2);
    return doubled_area * doubled_area < sine2 * product;
  }
};

/// Products of differences of coordinates, and sums of two, are exact in a double where all points
/// lie in a box no wider than this (but for a few steps).
inline constexpr std::int64_t kNarrow = 1 << 25;

/// p: in steps from the cavity's origin. Exact, see kNarrow.
[[gnu::always_inline]] inline PairView view_narrow(const RimPair& r, Pair px, Pair py) {
  const Pair ax = r.ax - px, ay = r.ay - py, bx = r.bx - px, by = r.by - py;
  const Pair pa2 = ax * ax + ay * ay, pb2 = bx * bx + by * by, dot = ax * bx + ay * by;
  const Pair at_a = pa2 - dot, at_b = pb2 - dot;
  return {ax * by - ay * bx, pa2, pb2, at_a + at_b, dot, at_a, at_b};
}

/// The same for any points: all signs are exact, and squares are rounded once.
[[gnu::noinline]] inline PairView view_wide(const RimPair& r, Pair px, Pair py) {
  PairView out{};
  for (std::size_t k = 0; k < 2; ++k) {
    const auto ax = static_cast<std::int64_t>(r.ax[k] - px[k]),
               ay = static_cast<std::int64_t>(r.ay[k] - py[k]),
               bx = static_cast<std::int64_t>(r.bx[k] - px[k]),
               by = static_cast<std::int64_t>(r.by[k] - py[k]);
    const std::int64_t pa2 = ax * ax + ay * ay, pb2 = bx * bx + by * by, dot = ax * bx + ay * by;
    out.doubled_area[k] = static_cast<double>(ax * by - ay * bx);
    out.pa2[k] = static_cast<double>(pa2);
    out.pb2[k] = static_cast<double>(pb2);
    out.ab2[k] = static_cast<double>(pa2 + pb2 - 2 * dot);
    out.at_p[k] = static_cast<double>(dot);
    out.at_a[k] = static_cast<double>(pa2 - dot);
    out.at_b[k] = static_cast<double>(pb2 - dot);
  }
  return out;
}

}  // namespace trocar::pipeline
