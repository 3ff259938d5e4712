// SPDX-License-Identifier: Apache-2.0
// Measures the triangles between a new point and the edges of its cavity's boundary, four triangles
// at a time. (A cavity is the set of triangles that the insertion of the point replaces.)
// Refinement spends most of its time in these functions. They have no branches, because a processor
// cannot predict whether a triangle violates the limits of shape (is bad), and each wrong
// prediction costs time. Nearly always, the whole boundary lies within kMaxBoundaryOffset of the
// point for which the cavity was found. Coordinates relative to this point then fit into 16 bits,
// and one instruction computes four dot products.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <limits>
#include <numbers>
#include <span>
#include <tuple>
#include <utility>
#include <vector>

#include "formats/mesh/lattice.h"
#include "formats/mesh/predicates.h"
#include "formats/mesh/refinement.h"
#include "formats/mesh/triangulation.h"

#ifdef __SSE2__
#include <emmintrin.h>
#endif

namespace trocar {

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

// Decides whether a triangle is within the bounds on angle and area that refinement must meet.

/// The bounds on angle and area that refinement must meet. All areas are doubled and in steps^2,
/// because twice the area of a triangle on the lattice is an integer.
class TriangleBounds {
 public:
  /// `options` must outlive this object.
  TriangleBounds(const Lattice& lattice, const RefinementOptions& options)
      : area_mm2_at_(options.area_mm2_at), has_area_at_(options.area_mm2_at != nullptr) {
    const double sine = std::sin(options.min_angle_deg * std::numbers::pi / 180);
    const double step2 = lattice.step_mm() * lattice.step_mm();
    doubled_per_mm2_ = 2 / step2;
    everywhere_ = {sine * sine, 2 * options.max_area_mm2 / step2};
    least_doubled_area_ = options.min_area_mm2 * doubled_per_mm2_;
  }

  /// Returns true if the bound on the area depends on the position.
  bool has_area_at() const { return has_area_at_; }
  /// The bounds on angle and area, without the bound that depends on the position.
  const ShapeLimits& everywhere() const { return everywhere_; }
  /// Limits that suffice at every position: a triangle within these limits is within the
  /// bounds, wherever it lies. (Where the bound on the area is larger, larger triangles are
  /// within the bounds too.)
  QuickShapeLimits anywhere() const {
    return {everywhere_.sine2, has_area_at_
                                   ? std::min(least_doubled_area_, everywhere_.doubled_area)
                                   : everywhere_.doubled_area};
  }
  /// The bound on the doubled area of a triangle, evaluated at its centroid.
  double largest_doubled_area(LatticePoint a, LatticePoint b, LatticePoint c) const {
    if (!has_area_at_) return everywhere_.doubled_area;
    const auto third = [](std::int64_t sum) { return static_cast<std::int32_t>(sum / 3); };
    const LatticePoint centroid{third(std::int64_t{a.x} + b.x + c.x),
                                third(std::int64_t{a.y} + b.y + c.y)};
    return std::min(everywhere_.doubled_area,
                    std::max(least_doubled_area_, area_mm2_at_(centroid) * doubled_per_mm2_));
  }
  /// The shape of the triangle abc. The members is_sharp and is_large say whether the triangle
  /// violates the bounds.
  TriangleShape shape(LatticePoint a, LatticePoint b, LatticePoint c) const {
    TriangleShape out = shape_of(a, b, c, everywhere_);
    if (has_area_at_ && static_cast<double>(out.doubled_area) > least_doubled_area_)
      out.is_large = static_cast<double>(out.doubled_area) > largest_doubled_area(a, b, c);
    return out;
  }

 private:
  const std::function<double(LatticePoint)>& area_mm2_at_;
  bool has_area_at_;
  double doubled_per_mm2_ = 0, least_doubled_area_ = 0;
  ShapeLimits everywhere_{};
};

// A priority queue of the triangles that refinement has to improve. Triangles with the shortest
// edges come first, in approximate order: they are sorted into buckets by the squared length of
// their shortest edge. From each power of two to the next there are four buckets of equal width.
// Within a bucket the newest triangle comes first. If a triangle is replaced, its entry stays in
// the queue until pop() drops it.

class RefinementQueue {
 public:
  /// A triangle, and the generation that it had when the entry was made. When the triangle is
  /// replaced, its generation changes (WorkingTriangle::generation), and the entry becomes stale.
  struct Entry {
    std::uint32_t triangle, generation;
  };

  void clear() {
    for (std::vector<Entry>& bucket : buckets_)
      bucket.clear();
    used_ = {};
  }

  /// Adds an entry. `shortest2` is the squared length of the shortest edge, from 1 to below 2^64.
  void push(double shortest2, Entry entry) {
    // The bucket follows from the exponent of the double and the first two bits of its mantissa, so
    // there are four buckets for each power of two.
    const auto digits = std::bit_cast<std::uint64_t>(shortest2) >> 50;
    const std::size_t k = (digits - (1023U << 2)) & (buckets_.size() - 1);
    buckets_[k].push_back(entry);
    used_[k / 64] |= std::uint64_t{1} << (k % 64);
  }

  /// Removes the first entry for which is_valid() holds and puts it into `out`. Drops the entries
  /// before it. Returns false if there is no such entry.
  template <typename IsValid>
  bool pop(Entry& out, IsValid is_valid) {
    for (std::size_t word = 0; word < used_.size(); ++word) {
      for (; used_[word] != 0; used_[word] &= used_[word] - 1) {
        std::vector<Entry>& bucket =
            buckets_[64 * word + static_cast<std::size_t>(std::countr_zero(used_[word]))];
        while (!bucket.empty()) {
          out = bucket.back();
          bucket.pop_back();
          if (is_valid(out)) return true;
        }
      }
    }
    return false;
  }

 private:
  std::array<std::vector<Entry>, 256> buckets_;
  std::array<std::uint64_t, 4> used_{};  // one bit for each bucket that may have entries
};

// The mesh during refinement, stored in flat arrays, and the insertion of points into it. The
// triangles whose circumcircles contain a new point form the point's cavity. An insertion replaces
// the cavity by triangles around the point (Bowyer; Watson, 1981).

/// A flag in the elements of WorkingTriangle::beyond, which has one element for each edge. If the
/// edge is on the outline, the element consists of this flag and the input segment's number.
/// Otherwise the element is the EdgeId of the same edge in the neighbouring triangle.
inline constexpr std::uint32_t kOutline = 0x80000000;

/// A triangle's circumcircle, prepared for tests of many points. It stores the coefficients with
/// which in_circle() becomes a polynomial in the coordinates of the tested point. Results are
/// exact. 64 bits suffice if all differences of coordinates are below kMaxDifference, which is
/// nearly always the case.
class Circumcircle {
 public:
  Circumcircle() = default;
  Circumcircle(LatticePoint a, LatticePoint b, LatticePoint c) {
    const std::int64_t bx = std::int64_t{b.x} - a.x, by = std::int64_t{b.y} - a.y;
    const std::int64_t cx = std::int64_t{c.x} - a.x, cy = std::int64_t{c.y} - a.y;
    if (!(is_near_origin(bx, by) && is_near_origin(cx, cy))) return;
    origin_ = a;
    const std::int64_t b2 = bx * bx + by * by, c2 = cx * cx + cy * cy;
    x_ = b2 * cy - c2 * by;
    y_ = c2 * bx - b2 * cx;
    area2_ = bx * cy - by * cx;
  }

  /// Returns true if 64 bits suffice for contains(p).
  bool is_near(LatticePoint p) const {
    return is_near_origin(std::int64_t{p.x} - origin_.x, std::int64_t{p.y} - origin_.y);
  }
  /// Returns 1 if p lies strictly inside, and 0 otherwise. The function has no comparison, because
  /// a compiler might turn a comparison into a branch, and a processor could not predict this
  /// branch. Precondition: is_near(p).
  std::uint32_t contains(LatticePoint p) const {
    const auto dx = static_cast<std::uint64_t>(std::int64_t{p.x} - origin_.x),
               dy = static_cast<std::uint64_t>(std::int64_t{p.y} - origin_.y);
    const std::uint64_t outside =
        (dx * dx + dy * dy) * static_cast<std::uint64_t>(area2_) -
        (dx * static_cast<std::uint64_t>(x_) + dy * static_cast<std::uint64_t>(y_));
    return static_cast<std::uint32_t>(outside >> 63);
  }

 private:
  // If differences are below M, then |x_| and |y_| are below 4 M^3 and area2_ is below 2 M^2. All
  // sums therefore stay below 12 M^4 < 2^63.
  static constexpr std::int64_t kMaxDifference = 1 << 14;
  static bool is_near_origin(std::int64_t x, std::int64_t y) {
    return (static_cast<std::uint64_t>(x + kMaxDifference) |
            static_cast<std::uint64_t>(y + kMaxDifference)) < 2 * kMaxDifference;
  }

  std::int64_t x_ = 0, y_ = 0, area2_ = 0;
  // If the triangle is too large for 64 bits, the origin keeps this value far outside the lattice,
  // so that is_near() is false for every point.
  LatticePoint origin_{std::numeric_limits<std::int32_t>::max(),
                       std::numeric_limits<std::int32_t>::max()};
};

/// A triangle. It occupies exactly one cache line, so that one access to memory reads all of it.
struct alignas(64) WorkingTriangle {
  Circumcircle circle;
  std::array<std::uint32_t, 3> v{};       ///< vertices, counter-clockwise
  std::array<std::uint32_t, 3> beyond{};  ///< see kOutline
  std::uint32_t visit = 0;                ///< number of the last search that visited this triangle
  std::uint32_t generation : 31 = 0;      ///< incremented when the triangle is replaced
  std::uint32_t is_bad : 1 = 0;           ///< 1 if the triangle has to be improved
};

/// The triangles that an insertion replaces by triangles around the new point, and the boundary of
/// the replaced triangles.
class InsertionCavity {
 public:
  struct BoundaryEdge {
    std::uint32_t a, b;    ///< ends of the edge, with the cavity on its left
    std::uint32_t beyond;  ///< WorkingTriangle::beyond of the edge
    EdgeId inside;         ///< the same edge in the triangle of the cavity
  };

  std::span<const BoundaryEdge> boundary() const { return {boundary_.data(), edges_}; }
  /// The edges of the boundary in groups of four.
  std::span<const BoundaryQuad> quads() const { return {quads_.data(), (edges_ + 3) / 4}; }
  std::span<BoundaryQuad> quads() { return {quads_.data(), (edges_ + 3) / 4}; }
  /// The four edges of group k.
  const BoundaryEdge* edges_of_quad(std::size_t k) const { return boundary_.data() + 4 * k; }
  /// The number of triangles in the cavity.
  std::uint32_t size() const { return triangles_; }
  /// The new triangle on edge k of the boundary, after fill_cavity().
  std::uint32_t fresh_triangle(std::size_t k) const { return triangle_of(entries_[k]); }
  int bad_triangles() const { return bad_; }
  /// Returns true if the boundary lies within kMaxBoundaryOffset of the origin.
  bool is_near_origin() const { return is_near_origin_; }

  LatticePoint origin;  ///< the new point

 private:
  friend class RefinementMesh;

  // Grows the arrays, with space for three more edges than capacity_. list_boundary() needs this
  // space to fill up the last group of four edges.
  [[gnu::noinline]] void grow() {
    capacity_ = 2 * capacity_ + 64;
    entries_.resize(capacity_ + 3), sides_.resize(capacity_ + 3), boundary_.resize(capacity_ + 3);
    quads_.resize(capacity_ / 4 + 1);
  }

  std::size_t capacity_ = 0;
  std::uint32_t triangles_ = 0, edges_ = 0;
  int bad_ = 0;
  bool is_near_origin_ = false;
  // One entry for each triangle of the cavity: the edge through which the search entered it.
  // fill_cavity() appends an edge of each triangle that it adds to the mesh.
  std::vector<EdgeId> entries_;
  // One entry for each boundary edge: BoundaryEdge::beyond in the upper 32 bits,
  // BoundaryEdge::inside in the lower ones.
  std::vector<std::uint64_t> sides_;
  std::vector<BoundaryEdge> boundary_;
  std::vector<BoundaryQuad> quads_;
};

class RefinementMesh {
 public:
  std::vector<LatticePoint> points;
  std::vector<WorkingTriangle> triangles;

  /// Replaces the mesh by a new triangulation and keeps the memory. `segment(a, b)` returns the
  /// number of the input segment for the outline's edge from a to b.
  template <typename Segment>
  void assign(const Triangulation& from, Segment segment) {
    // The meshes of long outlines grow to about this multiple of their first size. Reserving memory
    // for this size avoids copies, and reserved pages that stay unused cost nothing.
    constexpr std::size_t kGrowth = 2;
    points.reserve(kGrowth * from.mesh.vertices.size());
    star_.reserve(kGrowth * from.mesh.vertices.size());
    triangles.reserve(kGrowth * from.mesh.triangles.size());
    points.assign(from.mesh.vertices.begin(), from.mesh.vertices.end());
    triangles.resize(from.mesh.triangles.size());
    for (std::uint32_t t = 0; t < triangles.size(); ++t) {
      const Triangle& v = from.mesh.triangles[t];
      triangles[t] = {{points[v[0]], points[v[1]], points[v[2]]}, v, from.beyond[t]};
    }
    // Number the edges on the outline. A processor cannot predict which edges are on the outline,
    // so they are first listed, without branches, for one block of triangles after another.
    constexpr std::uint32_t kBlock = 64;
    std::array<EdgeId, 3 * kBlock + 1> outline;
    for (std::uint32_t first = 0; first < triangles.size(); first += kBlock) {
      const auto end = std::min(first + kBlock, static_cast<std::uint32_t>(triangles.size()));
      std::size_t edges = 0;
      for (std::uint32_t t = first; t < end; ++t) {
        for (std::uint32_t i = 0; i < 3; ++i) {
          outline[edges] = edge_id(t, i);
          edges += from.beyond[t][i] == kNoEdge ? 1 : 0;
        }
      }
      for (std::size_t k = 0; k < edges; ++k) {
        const auto [a, b] = ends(outline[k]);
        triangles[triangle_of(outline[k])].beyond[index_of(outline[k])] = kOutline | segment(a, b);
      }
    }
    visits_ = 0;
    star_.assign(points.size(), 0);
  }

  std::uint32_t beyond(EdgeId e) const { return triangles[triangle_of(e)].beyond[index_of(e)]; }
  std::pair<std::uint32_t, std::uint32_t> ends(EdgeId e) const {
    const WorkingTriangle& t = triangles[triangle_of(e)];
    return {t.v[index_of(e)], t.v[next_corner(index_of(e))]};
  }
  std::uint32_t apex(EdgeId e) const {
    return triangles[triangle_of(e)].v[previous_corner(index_of(e))];
  }

  /// Returns true if p is strictly inside the circumcircle of triangle t. Exact.
  bool circumcircle_contains(std::uint32_t t, LatticePoint p) const {
    const WorkingTriangle& tri = triangles[t];
    return tri.circle.is_near(p) ? tri.circle.contains(p) != 0 : far_circle_contains(tri, p);
  }

  static constexpr std::uint32_t kNone = 0xffffffff;
  /// Returns the triangle that contains p. The search goes from `start` through neighbouring
  /// triangles towards p. Returns kNone if the search meets the outline, or has not found p
  /// after 64 triangles.
  std::uint32_t find(std::uint32_t start, LatticePoint p) const {
    std::uint32_t t = start;
    for (int step = 0; step < 64; ++step) {
      const WorkingTriangle& tri = triangles[t];
      std::uint32_t i = 0;
      while (i < 3 && orient2d(points[tri.v[i]], points[tri.v[next_corner(i)]], p) >= 0)
        ++i;
      if (i == 3) return t;
      if ((tri.beyond[i] & kOutline) != 0) return kNone;
      t = triangle_of(tri.beyond[i]);
    }
    return kNone;
  }

  /// Finds the cavity of p: `start`, all triangles connected with `start` whose circumcircles
  /// contain p, and the edges around these triangles. Precondition: p lies in `start` or in its
  /// circumcircle. No branch depends on whether a neighbour belongs to the cavity, because a
  /// processor could not predict the branch.
  void find_cavity(std::uint32_t start, LatticePoint p, InsertionCavity& cavity) {
    find<false>(start, kNoEdge, p, cavity);
  }
  /// Finds the cavity of a point p that splits the edge `split` of the outline. The cavity's
  /// boundary then does not list the split edge.
  void find_split_cavity(EdgeId split, LatticePoint p, InsertionCavity& cavity) {
    find<true>(triangle_of(split), split, p, cavity);
  }

  /// Replaces the triangles of the cavity by triangles around a new vertex p. Edge k of the
  /// boundary becomes edge 0 of cavity.fresh_triangle(k). `split` is the edge of the outline that p
  /// splits, or kNoEdge. Precondition: p lies to the left of all edges of the boundary. Without
  /// `split`, the boundary must be one closed loop; with `split`, one loop that is open at the
  /// split edge. If it is not, the function returns false and changes nothing.
  bool fill_cavity(InsertionCavity& cavity, LatticePoint p, EdgeId split) {
    return split == kNoEdge ? fill<false>(cavity, p, split) : fill<true>(cavity, p, split);
  }

 private:
  template <bool kIsSplit>
  [[gnu::noinline]] void find(std::uint32_t start, EdgeId split, LatticePoint p,
                              InsertionCavity& cavity) {
    // Each edge is written before it is known whether it belongs to the boundary, which avoids a
    // branch. The arrays therefore always need space for the edges of one more triangle. (A cavity
    // has at most two more boundary edges than triangles.)
    constexpr std::uint32_t kMargin = 6;
    if (cavity.capacity_ < kMargin) cavity.grow();
    const std::uint32_t visit = ++visits_;
    WorkingTriangle* const all = triangles.data();
    EdgeId* entries = cavity.entries_.data();
    std::uint64_t* sides = cavity.sides_.data();
    auto most = static_cast<std::uint32_t>(cavity.capacity_) - kMargin;
    std::uint32_t reached = 1, edges = 0;
    const auto inspect_beyond = [&](std::uint32_t t, std::uint32_t i)
        __attribute__((always_inline)) {
      const std::uint32_t beyond = all[t].beyond[i];
      const std::uint32_t is_outline = beyond >> 31;
      // An edge of the outline has no neighbour beyond it; the triangle itself is used instead.
      const std::uint32_t across = triangle_of(beyond);
      WorkingTriangle& next = all[across ^ ((across ^ t) & -is_outline)];
      std::uint32_t is_in = next.circle.contains(p);
      if (!next.circle.is_near(p)) [[unlikely]]
        is_in = far_circle_contains(next, p) ? 1 : 0;
      entries[reached] = beyond;
      sides[edges] = std::uint64_t{beyond} << 32 | edge_id(t, i);
      reached += is_in & static_cast<std::uint32_t>(next.visit != visit);
      edges += (is_in ^ 1) | is_outline;
      next.visit = visit;  // no effect on a triangle outside the cavity: its is_in is always 0
    };
    all[start].visit = visit;
    entries[0] = kIsSplit ? split : edge_id(start, 0);
    int bad = 0;
    if (!kIsSplit) inspect_beyond(start, 0);
    for (std::uint32_t k = 0; k < reached; ++k) {
      if (reached > most) [[unlikely]] {
        cavity.grow();
        entries = cavity.entries_.data();
        sides = cavity.sides_.data();
        most = static_cast<std::uint32_t>(cavity.capacity_) - kMargin;
      }
      const std::uint32_t t = triangle_of(entries[k]), from = index_of(entries[k]);
      bad += all[t].is_bad;
      inspect_beyond(t, (from - 1) >> 31);  // 1 if from is 0, else 0
      inspect_beyond(t, 2 - (from >> 1));   // 1 if from is 2, else 2
    }
    cavity.triangles_ = reached;
    cavity.edges_ = edges;
    cavity.bad_ = bad;
    cavity.origin = p;
    if (edges == 0) return;
    list_boundary<kIsSplit>(split, cavity);
  }

  template <bool kIsSplit>
  [[gnu::noinline]] bool fill(InsertionCavity& cavity, LatticePoint p, EdgeId split) {
    // The boundary of n triangles has n + 2 edges if it is closed, and n + 1 without
    // the split edge.
    constexpr std::uint32_t kMore = kIsSplit ? 1 : 2;
    const std::uint32_t kept = cavity.size(), n = kept + kMore;
    if (cavity.boundary().size() != n) return false;
    const InsertionCavity::BoundaryEdge* const boundary = cavity.boundary().data();
    std::uint32_t open = 0, first = 0, last = 0;
    if (kIsSplit) open = beyond(split), std::tie(last, first) = ends(split);
    const auto v = static_cast<std::uint32_t>(points.size());
    points.push_back(p);
    star_.push_back(0);
    for (std::uint32_t k = 0; k < kMore; ++k) {
      cavity.entries_[kept + k] = edge_id(static_cast<std::uint32_t>(triangles.size()), 0);
      triangles.emplace_back();
    }
    const LatticePoint* const at = points.data();
    WorkingTriangle* const all = triangles.data();
    std::uint32_t* const star = star_.data();
    for (std::uint32_t k = 0; k < n; ++k) {
      const InsertionCavity::BoundaryEdge& r = boundary[k];
      const std::uint32_t t = cavity.fresh_triangle(k);
      WorkingTriangle& tri = all[t];
      tri.circle = {at[r.a], at[r.b], p};
      tri.v = {r.a, r.b, v};
      ++tri.generation;
      tri.is_bad = 0;
      star[r.a] = t;
      // The triangle beyond the edge gets the new triangle as its neighbour. There is no triangle
      // beyond an edge of the outline: the write then goes to the edge's own new triangle, where
      // the later assignment to tri.beyond overwrites it.
      const std::uint32_t is_outline = r.beyond >> 31,
                          target = (r.beyond & (is_outline - 1)) | (edge_id(t, 0) & -is_outline);
      all[triangle_of(target)].beyond[index_of(target)] = edge_id(t, 0);
      tri.beyond = {r.beyond, open, open};
    }
    // Join the triangle of each edge to the triangle of the next edge. A boundary that is open at
    // the split edge is first joined as if it were closed; then its two ends are separated again.
    if (kIsSplit) star[last] = star[first];
    for (std::uint32_t k = 0; k < n; ++k) {
      const std::uint32_t t = cavity.fresh_triangle(k), next = star[boundary[k].b];
      all[t].beyond[1] = edge_id(next, 2);
      all[next].beyond[2] = edge_id(t, 1);
    }
    if (kIsSplit) {
      std::uint32_t& closed = all[star[first]].beyond[2];
      all[triangle_of(closed)].beyond[1] = open;
      closed = open;
    }
    return true;
  }

  // Makes the list of boundary edges from sides_, in which find() has collected them. `split` is
  // the edge of the outline that is to be split, or kNoEdge.
  template <bool kIsSplit>
  [[gnu::always_inline]] void list_boundary(EdgeId split, InsertionCavity& cavity) const {
    const std::uint32_t n = cavity.edges_;
    std::uint32_t from = 0, to = 0;
    if (kIsSplit) std::tie(from, to) = ends(split);
    const LatticePoint* const at = points.data();
    const WorkingTriangle* const all = triangles.data();
    const LatticePoint o = cavity.origin;
    std::uint64_t* const sides = cavity.sides_.data();
    InsertionCavity::BoundaryEdge* boundary = cavity.boundary_.data();
    BoundaryQuad* quad = cavity.quads_.data();
    for (std::uint32_t k = 0; k < 3; ++k)
      sides[n + k] = sides[n - 1];
    Four is_beyond{};
    for (std::uint32_t k = 0; k < n; k += 4, boundary += 4, ++quad) {
      for (std::uint32_t i = 0; i < 4; ++i) {
        const std::uint64_t side = sides[k + i];
        const std::uint32_t corner = index_of(static_cast<EdgeId>(side));
        const WorkingTriangle& tri = all[triangle_of(static_cast<EdgeId>(side))];
        boundary[i].a = tri.v[corner];
        boundary[i].b = tri.v[next_corner(corner)];
        boundary[i].beyond = static_cast<std::uint32_t>(side >> 32);
        boundary[i].inside = static_cast<EdgeId>(side);
      }
      quad->a = narrowed(from_origin(at[boundary[0].a], at[boundary[1].a], o),
                         from_origin(at[boundary[2].a], at[boundary[3].a], o));
      quad->b = narrowed(from_origin(at[boundary[0].b], at[boundary[1].b], o),
                         from_origin(at[boundary[2].b], at[boundary[3].b], o));
      is_beyond |= is_beyond_max_offset(quad->a) | is_beyond_max_offset(quad->b);
      const auto left = static_cast<std::int32_t>(n - k);
      quad->is_edge = Four{0, 1, 2, 3} < four_of(left);
      quad->is_outline = Four{static_cast<std::int32_t>(boundary[0].beyond),
                              static_cast<std::int32_t>(boundary[1].beyond),
                              static_cast<std::int32_t>(boundary[2].beyond),
                              static_cast<std::int32_t>(boundary[3].beyond)} < 0;
      if (kIsSplit) {
        const auto equal = [](std::uint32_t p, std::uint32_t q, std::uint32_t r, std::uint32_t s,
                              std::uint32_t v) {
          using Unsigned = std::uint32_t __attribute__((vector_size(16)));
          return Unsigned{p, q, r, s} == Unsigned{v, v, v, v};
        };
        quad->is_before =
            equal(boundary[0].b, boundary[1].b, boundary[2].b, boundary[3].b, from) & quad->is_edge;
        quad->is_after =
            equal(boundary[0].a, boundary[1].a, boundary[2].a, boundary[3].a, to) & quad->is_edge;
      }
    }
    cavity.is_near_origin_ = !is_any(is_beyond);
  }

  [[gnu::noinline]] bool far_circle_contains(const WorkingTriangle& t, LatticePoint p) const {
    return in_circle(points[t.v[0]], points[t.v[1]], points[t.v[2]], p) > 0;
  }

  std::uint32_t visits_ = 0;
  // One entry for each vertex, used by fill(): the new triangle whose boundary edge starts there.
  std::vector<std::uint32_t> star_;
};

}  // namespace trocar
