// SPDX-License-Identifier: Apache-2.0
// The laws of formats/mesh/lattice.h over the whole lattice: the exact predicates equal the
// textbook's determinants in 512-bit integers.
#include <boost/multiprecision/cpp_int.hpp>

#include "formats/mesh/lattice.h"
#include "tests/properties/property_fixture.h"
#include "tests/support/random_geometry.h"

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

// Equality with the determinants implies all their symmetries: signs under swaps, invariance under
// motions, additivity of areas, and that one diagonal of a convex quadrilateral is Delaunay.
class Predicates : public testing::TestWithParam<std::int32_t> {};

TEST_P(Predicates, EqualTheTextbookDeterminants) {
  runtime::Random random(7);
  const auto next = [&] { return random.point(-GetParam(), GetParam()); };
  for (int i = 0; i < 20'000; ++i) {
    const P a = next(), b = next(), c = next(), d = next();
    ASSERT_EQ(Big(orient2d(a, b, c)), wide_orient(a, b, c));
    ASSERT_EQ(in_circle(a, b, c, d), wide_circle(a, b, c, d));
    ASSERT_EQ(in_circle(a, b, c, a), 0);
  }
}

// 2 and 5 make nearly every configuration degenerate; kMaxCoordinate is the stated limit.
INSTANTIATE_TEST_SUITE_P(Extents, Predicates, testing::Values(2, 5, 1000, 1 << 24, kMaxCoordinate));

TEST(Predicates, TheCornersOfASquareAreCocircular) {
  const std::int32_t m = kMaxCoordinate;
  EXPECT_EQ(orient2d({0, 0}, {1, 0}, {0, 1}), 1) << "counter-clockwise is positive";
  EXPECT_EQ(in_circle({-m, -m}, {m, -m}, {m, m}, {-m, m}), 0);
  EXPECT_EQ(in_circle({-m, -m}, {m, -m}, {m, m}, {-m + 1, m}), 1);
  EXPECT_EQ(in_circle({-m, -m + 1}, {m, -m}, {m, m}, {-m, m}), -1);
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

TEST(SegmentsCross, CountsAllCommonPointsExceptSharedEnds) {
  EXPECT_TRUE(segments_cross({0, 0}, {4, 4}, {0, 4}, {4, 0}));   // proper
  EXPECT_FALSE(segments_cross({0, 0}, {4, 4}, {4, 4}, {8, 0}));  // shared end
  EXPECT_TRUE(segments_cross({0, 0}, {4, 4}, {2, 2}, {8, 0}));   // end in the other's inside
  EXPECT_TRUE(segments_cross({0, 0}, {4, 0}, {2, 0}, {6, 0}));   // overlap
  EXPECT_TRUE(segments_cross({0, 0}, {4, 0}, {4, 0}, {0, 0}));   // the same, reversed
  EXPECT_TRUE(segments_cross({0, 0}, {4, 0}, {0, 0}, {2, 0}));   // overlap from a shared end
  EXPECT_FALSE(segments_cross({0, 0}, {4, 0}, {4, 0}, {8, 0}));  // collinear, one shared end
  EXPECT_FALSE(segments_cross({0, 0}, {4, 0}, {5, 0}, {8, 0}));  // collinear, apart
  EXPECT_FALSE(segments_cross({0, 0}, {4, 0}, {0, 1}, {4, 1}));  // parallel
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
