// SPDX-License-Identifier: Apache-2.0
// The exact predicates over the whole lattice: equality with the textbook's determinants,
// symmetries, invariance under motions, and the consistency that the proofs of meshing rely on.
#include <boost/multiprecision/cpp_int.hpp>

#include "formats/mesh/lattice.h"
#include "tests/properties/property_fixture.h"

namespace trocar {
namespace {

using P = LatticePoint;

int sign(std::int64_t x) {
  return (x > 0) - (x < 0);
}
// A rotation about the origin, and a translation that keeps the points on the lattice.
test::Motion motion_within_bounds(std::initializer_list<P> points) {
  std::int32_t low_x = 0, high_x = 0, low_y = 0, high_y = 0;
  test::Motion out{test::any_in(0, 4), {}};
  for (const P p : points) {
    const P q = out(p);
    low_x = std::min(low_x, q.x), high_x = std::max(high_x, q.x);
    low_y = std::min(low_y, q.y), high_y = std::max(high_y, q.y);
  }
  out.by = {test::any_in(-kMaxCoordinate - low_x, kMaxCoordinate - high_x + 1),
            test::any_in(-kMaxCoordinate - low_y, kMaxCoordinate - high_y + 1)};
  return out;
}

using Big = boost::multiprecision::int512_t;

// The textbook's determinants in wide integers.
Big wide_orient(P a, P b, P c) {
  return (Big(b.x) - a.x) * (Big(c.y) - a.y) - (Big(b.y) - a.y) * (Big(c.x) - a.x);
}
int wide_circle(P a, P b, P c, P d) {
  const auto lift = [](P p) { return Big(Big(p.x) * p.x + Big(p.y) * p.y); };
  const auto minor = [&](P p, P q, P r) {
    return Big(Big(p.x) * (Big(q.y) * lift(r) - lift(q) * r.y) -
               Big(p.y) * (Big(q.x) * lift(r) - lift(q) * r.x) +
               lift(p) * (Big(q.x) * r.y - Big(q.y) * r.x));
  };
  return Big(minor(a, b, c) - minor(a, b, d) + minor(a, c, d) - minor(b, c, d)).sign();
}

RC_GTEST_PROP(Orient2d, EqualsTheTextbookDeterminant, (P a, P b, P c)) {
  RC_ASSERT(Big(orient2d(a, b, c)) == wide_orient(a, b, c));
  RC_ASSERT(orient2d({0, 0}, {1, 0}, {0, 1}) == 1);  // counter-clockwise is positive
}

RC_GTEST_PROP(InCircle, EqualsTheTextbookDeterminant, (P a, P b, P c, P d)) {
  RC_ASSERT(in_circle(a, b, c, d) == wide_circle(a, b, c, d));
  RC_ASSERT(in_circle({0, 0}, {2, 0}, {0, 2}, {1, 1}) == 1);  // inside is positive
}

// Cases where double and 64-bit arithmetic fail: four points on one circle of any size, one of them
// possibly moved by a step.
RC_GTEST_PROP(InCircle, IsExactNearACircle, ()) {
  constexpr std::int32_t kFar = kMaxCoordinate / 2;
  const P v{test::any_in(-kFar + 2, kFar - 1), test::any_in(-kFar + 2, kFar - 1)};
  RC_PRE(v.x != 0 && v.y != 0 && std::abs(v.x) != std::abs(v.y));
  const P centre{test::any_in(-kFar, kFar + 1), test::any_in(-kFar, kFar + 1)};
  const auto at = [&](int turn, bool mirrored) {
    const P p = test::Motion{turn, centre}(mirrored ? P{v.y, v.x} : v);
    return p;
  };
  P a = at(0, false), b = at(1, *rc::gen::arbitrary<bool>()), c = at(2, false), d = at(3, true);
  RC_ASSERT(in_circle(a, b, c, d) == 0);
  d = {d.x + test::any_in(-1, 2), d.y + test::any_in(-1, 2)};
  RC_ASSERT(in_circle(a, b, c, d) == wide_circle(a, b, c, d));
}

RC_GTEST_PROP(Orient2d, ChangesItsSignWithASwap, (P a, P b, P c)) {
  RC_ASSERT(orient2d(a, b, c) == orient2d(b, c, a));
  RC_ASSERT(orient2d(a, b, c) == -orient2d(b, a, c));
  RC_ASSERT(orient2d(a, a, c) == 0);
}

RC_GTEST_PROP(Orient2d, IsInvariantUnderMotions, (P a, P b, P c)) {
  const test::Motion m = motion_within_bounds({a, b, c});
  RC_ASSERT(orient2d(m(a), m(b), m(c)) == orient2d(a, b, c));
}

// The area of a triangle is the sum of the three with any point.
RC_GTEST_PROP(Orient2d, IsAdditive, (P a, P b, P c, P d)) {
  RC_ASSERT(orient2d(a, b, c) == orient2d(a, b, d) + orient2d(b, c, d) + orient2d(c, a, d));
}

RC_GTEST_PROP(InCircle, ChangesItsSignWithASwap, (P a, P b, P c, P d)) {
  const int all = in_circle(a, b, c, d);
  RC_ASSERT(in_circle(b, c, a, d) == all);
  RC_ASSERT(in_circle(b, a, c, d) == -all);
  RC_ASSERT(in_circle(a, b, d, c) == -all);
  RC_ASSERT(in_circle(d, b, c, a) == -all);
  RC_ASSERT(in_circle(a, b, c, a) == 0);
}

RC_GTEST_PROP(InCircle, IsInvariantUnderMotions, (P a, P b, P c, P d)) {
  const test::Motion m = motion_within_bounds({a, b, c, d});
  RC_ASSERT(in_circle(m(a), m(b), m(c), m(d)) == in_circle(a, b, c, d));
}

// At least one diagonal of a convex quadrilateral is Delaunay, so flipping terminates.
RC_GTEST_PROP(InCircle, AtLeastOneDiagonalIsDelaunay, (P a, P b, P c, P d)) {
  // Most sets of four points are convex in some order.
  std::array<P, 4> p = {a, b, c, d};
  std::sort(p.begin(), p.end());
  const auto is_convex = [&p] {
    return orient2d(p[0], p[1], p[2]) > 0 && orient2d(p[0], p[2], p[3]) > 0 &&
           orient2d(p[0], p[1], p[3]) > 0 && orient2d(p[1], p[2], p[3]) > 0;
  };
  while (!is_convex() && std::next_permutation(p.begin(), p.end())) {
  }
  RC_PRE(is_convex());
  RC_ASSERT(in_circle(p[0], p[1], p[2], p[3]) == -in_circle(p[1], p[2], p[3], p[0]));
}

RC_GTEST_PROP(DiametralDot, IsThePowerOfThalesCircle, (P a, P b, P p)) {
  RC_PRE(a != b);
  const std::int64_t dot = diametral_dot(a, b, p);
  RC_ASSERT(dot == diametral_dot(b, a, p));
  // The law of cosines, evaluated exactly.
  const Int128 legs = Int128{distance2(a, p)} + distance2(b, p);
  RC_ASSERT(legs - distance2(a, b) == 2 * Int128{dot});
  const test::Motion m = motion_within_bounds({a, b, p});
  RC_ASSERT(diametral_dot(m(a), m(b), m(p)) == dot);
}

RC_GTEST_PROP(SegmentsCross, IsSymmetric, (P a, P b, P c, P d)) {
  RC_PRE(a != b && c != d);
  const bool cross = segments_cross(a, b, c, d);
  RC_ASSERT(segments_cross(b, a, c, d) == cross);
  RC_ASSERT(segments_cross(a, b, d, c) == cross);
  RC_ASSERT(segments_cross(c, d, a, b) == cross);
  const test::Motion m = motion_within_bounds({a, b, c, d});
  RC_ASSERT(segments_cross(m(a), m(b), m(c), m(d)) == cross);
  // Strictly on both sides of each other: crossing. All on one side: none.
  const int s1 = sign(orient2d(a, b, c)), s2 = sign(orient2d(a, b, d)),
            s3 = sign(orient2d(c, d, a)), s4 = sign(orient2d(c, d, b));
  if (s1 * s2 < 0 && s3 * s4 < 0) RC_ASSERT(cross);
  if (s1 * s2 > 0 || s3 * s4 > 0) RC_ASSERT(!cross);
}

RC_GTEST_PROP(SegmentsCross, ASharedEndIsNoCrossing, (P a, P b, P c)) {
  RC_PRE(orient2d(a, b, c) != 0);
  RC_ASSERT(!segments_cross(a, b, b, c));
  RC_ASSERT(!segments_cross(a, b, a, c));
  // A segment and itself cross.
  RC_ASSERT(segments_cross(a, b, b, a));
}

RC_GTEST_PROP(DoubledArea, IsTheSameFromEveryVertex, (std::vector<P> points)) {
  RC_PRE(points.size() >= 3);
  Ring ring(points.begin(),
            points.begin() + static_cast<std::ptrdiff_t>(std::min<std::size_t>(points.size(), 7)));
  const std::int64_t area = doubled_area(ring);
  std::rotate(ring.begin(), ring.begin() + 1, ring.end());
  RC_ASSERT(doubled_area(ring) == area);
  std::reverse(ring.begin(), ring.end());
  RC_ASSERT(doubled_area(ring) == -area);
}

// Snapping goes to the nearest lattice point; lattice points are unchanged.
RC_GTEST_PROP(Lattice, SnapsToTheNearest, ()) {
  const Lattice lattice{test::any_in(kMinLatticeBits, kMaxLatticeBits + 1)};
  const auto c = test::any_in<std::int32_t>(-kMaxCoordinate, kMaxCoordinate + 1);
  RC_ASSERT(lattice.snap_mm(lattice.to_mm(c)) == c);
  const double off = 0.49 * lattice.step_mm() * (test::any_in(-100, 101) / 100.0);
  RC_ASSERT(lattice.snap_mm(lattice.to_mm(c) + off) == c);
}

}  // namespace
}  // namespace trocar
