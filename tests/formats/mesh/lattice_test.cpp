// SPDX-License-Identifier: Apache-2.0
// The laws of formats/mesh/lattice.h, compared with 512-bit integers.
#include "formats/mesh/lattice.h"

#include <gtest/gtest.h>

#include <boost/multiprecision/cpp_int.hpp>
#include <random>

namespace trocar {
namespace {

using Big = boost::multiprecision::int512_t;

int big_sign(const Big& v) {
  return v > 0 ? 1 : (v < 0 ? -1 : 0);
}
int sign(std::int64_t v) {
  return (v > 0) - (v < 0);
}

Big big_orient(LatticePoint a, LatticePoint b, LatticePoint c) {
  return (Big(b.x) - a.x) * (Big(c.y) - a.y) - (Big(b.y) - a.y) * (Big(c.x) - a.x);
}

// The lifted 4 x 4 determinant, expanded along its column of ones: not the formula under test.
Big big_in_circle(LatticePoint a, LatticePoint b, LatticePoint c, LatticePoint d) {
  const auto lift = [](LatticePoint p) { return Big(p.x) * p.x + Big(p.y) * p.y; };
  const auto minor = [&](LatticePoint p, LatticePoint q, LatticePoint r) {
    return Big(p.x) * (Big(q.y) * lift(r) - lift(q) * r.y) -
           Big(p.y) * (Big(q.x) * lift(r) - lift(q) * r.x) +
           lift(p) * (Big(q.x) * r.y - Big(q.y) * r.x);
  };
  return minor(a, b, c) - minor(a, b, d) + minor(a, c, d) - minor(b, c, d);
}

class Points {
 public:
  explicit Points(std::int32_t extent) : extent_(extent) {}
  LatticePoint next() { return {coordinate(), coordinate()}; }

 private:
  std::int32_t coordinate() {
    return static_cast<std::int32_t>(rng_() % (2 * static_cast<std::uint64_t>(extent_) + 1)) -
           extent_;
  }
  std::mt19937_64 rng_{7};
  std::int32_t extent_;
};

class Predicates : public testing::TestWithParam<std::int32_t> {};

TEST_P(Predicates, AgreeWithBigIntegersAndAreAntisymmetric) {
  Points points(GetParam());
  for (int i = 0; i < 20'000; ++i) {
    const LatticePoint a = points.next(), b = points.next(), c = points.next(), d = points.next();
    ASSERT_EQ(Big(orient2d(a, b, c)), big_orient(a, b, c));
    ASSERT_EQ(sign(orient2d(a, b, c)), -sign(orient2d(b, a, c)));
    if (orient2d(a, b, c) > 0) {
      ASSERT_EQ(in_circle(a, b, c, d), big_sign(big_in_circle(a, b, c, d)));
      ASSERT_EQ(in_circle(a, b, c, d), in_circle(b, c, a, d));
      ASSERT_EQ(in_circle(a, b, c, a), 0);
    }
  }
}

// 2 and 5 make nearly every configuration degenerate; kMaxCoordinate is the stated limit.
INSTANTIATE_TEST_SUITE_P(Extents, Predicates, testing::Values(2, 5, 1000, 1 << 24, kMaxCoordinate));

TEST(Predicates, TheCornersOfASquareAreCocircular) {
  const std::int32_t m = kMaxCoordinate;
  EXPECT_EQ(in_circle({-m, -m}, {m, -m}, {m, m}, {-m, m}), 0);
  EXPECT_EQ(in_circle({-m, -m}, {m, -m}, {m, m}, {-m + 1, m}), 1);
  EXPECT_EQ(in_circle({-m, -m + 1}, {m, -m}, {m, m}, {-m, m}), -1);
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

TEST(Lattice, SnapsToTheNearestMultiple) {
  const Lattice lattice{8};
  EXPECT_EQ(lattice.snap_mm(1.0), 256);
  EXPECT_EQ(lattice.snap_mm(-0.003), -1);
  EXPECT_EQ(lattice.snap_mm(lattice.to_mm(123456789)), 123456789);
}

}  // namespace
}  // namespace trocar
