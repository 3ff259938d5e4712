// SPDX-License-Identifier: Apache-2.0
// The operations that mesher and runtime share: edge numbering, edge predicates, canonical
// orientation, triangle shape, Steiner points and points that split an edge.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>
#include <vector>

#include "formats/mesh/canonical_rotation.h"
#include "formats/mesh/predicates.h"
#include "formats/mesh/steiner_points.h"

namespace trocar {
namespace {

class RandomTriangles {
 public:
  explicit RandomTriangles(std::int32_t extent) : extent_(extent) {}
  LatticePoint next() { return {coordinate(), coordinate()}; }
  TriangleCorners triangle() {
    while (true) {
      TriangleCorners v{next(), next(), next()};
      if (orient2d(v[0], v[1], v[2]) < 0) std::swap(v[0], v[1]);
      if (orient2d(v[0], v[1], v[2]) > 0) return v;
    }
  }

 private:
  std::int32_t coordinate() {
    return static_cast<std::int32_t>(rng_() % (2 * static_cast<std::uint64_t>(extent_) + 1)) -
           extent_;
  }
  std::mt19937_64 rng_{11};
  std::int32_t extent_;
};

TEST(EdgePredicates, LocallyDelaunayAgreesWithInCircle) {
  RandomTriangles points(6);  // small, so that four points on a circle are frequent
  int convex = 0;
  for (int k = 0; k < 50'000; ++k) {
    const auto [a, b, c] = points.triangle();
    const LatticePoint d = points.next();
    if (orient2d(d, c, b) <= 0) continue;
    ASSERT_EQ(is_locally_delaunay(a, b, c, d), in_circle(a, b, c, d) <= 0);
    ++convex;
  }
  EXPECT_GT(convex, 10'000);
}

TEST(EdgePredicates, PointsOnSegments) {
  const LatticePoint a{0, 0}, b{4, 2};
  EXPECT_TRUE(is_inside_segment(a, b, {2, 1}));
  EXPECT_FALSE(is_inside_segment(a, b, a));
  EXPECT_TRUE(is_on_segment(a, b, a));
  EXPECT_FALSE(is_on_segment(a, b, {6, 3}));
  EXPECT_FALSE(is_on_segment(a, b, {2, 2}));
}

TEST(TriangleShape, BothTestsOfTheSmallestAngleAgree) {
  RandomTriangles points(2000);
  const double angle = 20 * std::numbers::pi / 180;
  const double sine2 = std::sin(angle) * std::sin(angle), cos2 = std::cos(angle) * std::cos(angle);
  int sharp = 0;
  for (int k = 0; k < 50'000; ++k) {
    const TriangleCorners v = points.triangle();
    const TriangleShape shape = shape_of(v[0], v[1], v[2], {sine2, 1e18});
    ASSERT_EQ(shape.is_sharp, is_angle_below_cosine(v, cos2));
    ASSERT_EQ(shape.shortest2, static_cast<double>(shortest_edge(v).length2));
    sharp += shape.is_sharp ? 1 : 0;
  }
  EXPECT_GT(sharp, 10'000);
}

TEST(SegmentSplit, PointsLeaveTwoPositiveTrianglesAndNeverMoveTheEdgeOutwards) {
  RandomTriangles points(300);
  int near = 0, beside = 0;
  for (int k = 0; k < 20'000; ++k) {
    const auto [a, b, c] = points.triangle();
    const auto nearby = split_near(a, b, c, 0.42);
    const double x = a.x + 0.42 * (static_cast<double>(b.x) - a.x),
                 y = a.y + 0.42 * (static_cast<double>(b.y) - a.y);
    double nearest = std::numeric_limits<double>::max();
    for (const double u : {std::floor(x), std::floor(x) + 1}) {
      for (const double v : {std::floor(y), std::floor(y) + 1}) {
        const LatticePoint q{static_cast<std::int32_t>(u), static_cast<std::int32_t>(v)};
        if (may_split(a, b, c, q)) nearest = std::min(nearest, std::hypot(u - x, v - y));
      }
    }
    ASSERT_EQ(nearby.has_value(), nearest < 2);
    if (nearby) {
      ASSERT_NEAR(std::hypot(nearby->x - x, nearby->y - y), nearest, 1e-6);
      ++near;
    }
    if (const auto m = split_beside_edge(a, b, c, {0.5, false, false})) {
      ASSERT_TRUE(may_split(a, b, c, *m));
      ++beside;
    }
    if (const auto m = split_on_edge(a, b, {0.5, false, false})) {
      ASSERT_TRUE(is_inside_segment(a, b, *m));
    }
  }
  EXPECT_GT(near, 15'000);
  EXPECT_GT(beside, 15'000);
}

TEST(SplitCell, GivesThePointsInTheOrderOfTheirSides) {
  RandomTriangles points(300);
  for (int k = 0; k < 20'000; ++k) {
    const auto [a, b, c] = points.triangle();
    const std::int64_t wanted = orient2d(a, b, c) / 64;
    SplitCell cell(a, b, 0.42);
    std::vector<std::int64_t> away, expected;
    for (std::size_t i = 0; i < 4; ++i) {
      ASSERT_EQ(cell.side(i), orient2d(a, b, cell.point(i)));
      expected.push_back(std::abs(cell.side(i) - wanted));
    }
    for (int i = 0; i < 4; ++i) {
      const std::size_t p = cell.nearest_side(wanted);
      ASSERT_FALSE(cell.is_excluded(p));
      away.push_back(std::abs(cell.side(p) - wanted));
      cell.exclude(p);
    }
    std::sort(expected.begin(), expected.end());
    ASSERT_EQ(away, expected);
    ASSERT_TRUE(cell.is_excluded(cell.nearest_side(wanted)));
  }
}

TEST(AngleCircle, ItsPointsSeeTheEdgeUnderTheAngle) {
  for (const double angle_deg : {10.0, 20.0, 30.0, 45.0}) {
    const double angle = angle_deg * std::numbers::pi / 180;
    const AngleCircle circle(angle);
    for (const double turn : {0.0, 0.5, -1.0}) {
      const EdgeOffset p = circle.at(std::sin(turn), std::cos(turn));
      const double seen = std::atan2(p.away, p.along - 0.5) - std::atan2(p.away, p.along + 0.5);
      EXPECT_NEAR(seen, angle, 1e-12);
    }
    EXPECT_NEAR(circle.off_centre_distance(), circle.at(0, 1).away, 1e-12);
  }
}

}  // namespace
}  // namespace trocar
