// SPDX-License-Identifier: GPL-3.0-or-later
// What is seen of four triangles at a time, compared with each of them in 64-bit integers.
// Compiled twice: with the processor's instructions and without them.
#include "formats/mesh/refinement_mesh.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <numbers>
#include <random>

#include "formats/mesh/predicates.h"

namespace trocar::pipeline {
namespace {

using Points = std::array<LatticePoint, 4>;

FourPoints four(const Points& p, LatticePoint origin = {}) {
  return narrowed(from_origin(p[0], p[1], origin), from_origin(p[2], p[3], origin));
}
bool is_near_origin(const Points& p, LatticePoint origin = {}) {
  return !is_any(is_beyond_max_offset(four(p, origin)));
}

class Random {
 public:
  std::int32_t up_to(std::int32_t extent) {
    return std::uniform_int_distribution(-extent, extent)(rng_);
  }
  Points points(std::int32_t extent) {
    Points out;
    for (LatticePoint& p : out)
      p = {up_to(extent), up_to(extent)};
    return out;
  }

 private:
  std::mt19937 rng_{11};
};

TEST(BoundaryTriangles, IsExactWithinReach) {
  Random random;
  for (int round = 0; round < 100'000; ++round) {
    const std::int32_t extent = round % 3 == 0 ? 3 : round % 3 == 1 ? 500 : kMaxBoundaryOffset - 1;
    Points from = random.points(extent), to = random.points(extent), p = random.points(extent);
    if (round % 7 == 0)
      from[0] = {-kMaxBoundaryOffset, -kMaxBoundaryOffset},
      to[0] = {kMaxBoundaryOffset - 1, -kMaxBoundaryOffset};
    if (round % 5 == 0) p[0] = {kMaxBoundaryOffset - 1, kMaxBoundaryOffset - 1};
    const BoundaryTriangles v = boundary_triangles(four(from), four(to), four(p));
    for (std::size_t k = 0; k < 4; ++k) {
      const LatticePoint a = from[k], b = to[k];
      ASSERT_EQ(v.doubled_area[k], orient2d(a, b, p[k]));
      ASSERT_EQ(v.pa2[k], distance2(p[k], a));
      ASSERT_EQ(v.pb2[k], distance2(p[k], b));
      ASSERT_EQ(v.ab2()[k], distance2(a, b));
      ASSERT_EQ(v.at_p[k], diametral_dot(a, b, p[k]));
      ASSERT_EQ(v.at_a[k], diametral_dot(b, p[k], a));
      ASSERT_EQ(v.at_b[k], diametral_dot(p[k], a, b));
    }
  }
}

TEST(BoundaryTriangles, NumbersThePointsInTheirOrder) {
  const Points p{{{1, 2}, {-3, 4}, {5, -6}, {-7, -8}}};
  const FourPoints all = four(p, {-10, 20});
  for (std::size_t k = 0; k < 4; ++k) {
    const FourPoints one = four_times(all, k);
    for (std::size_t i = 0; i < 4; ++i) {
      EXPECT_EQ(one[2 * i], p[k].x + 10);
      EXPECT_EQ(one[2 * i + 1], p[k].y - 20);
    }
  }
  for (unsigned bits = 0; bits < 16; ++bits) {
    Four mask{};
    for (std::size_t k = 0; k < 4; ++k)
      mask[k] = (bits >> k & 1) != 0 ? -1 : 0;
    EXPECT_EQ(bits_of(mask), bits);
    EXPECT_EQ(is_any(mask), bits != 0);
    EXPECT_EQ(count_of(mask + mask), 2 * std::popcount(bits));
  }
}

TEST(BoundaryTriangles, KnowsItsReach) {
  Random random;
  const LatticePoint origin{1 << 28, -(1 << 27)};
  for (int round = 0; round < 100'000; ++round) {
    // At the reach, at the ends of 16 bits and as far as the lattice goes.
    const std::array<std::int32_t, 3> ends{kMaxBoundaryOffset, 1 << 15, 1 << 29};
    Points p;
    bool is_near = true;
    for (LatticePoint& q : p) {
      const std::int32_t far = round % 2 == 0 ? kMaxBoundaryOffset - 2 : ends[round % 3];
      const std::int32_t dx = (random.up_to(1) < 0 ? -far : far) + random.up_to(2),
                         dy = random.up_to(kMaxBoundaryOffset - 1);
      q = {origin.x + dx, origin.y + dy};
      is_near = is_near && dx >= -kMaxBoundaryOffset && dx < kMaxBoundaryOffset;
    }
    ASSERT_EQ(is_near_origin(p, origin), is_near);
  }
}

TEST(BoundaryTriangles, IsUnsureOfFewTrianglesAndRightOfAllOthers) {
  Random random;
  int unsure = 0, sharp = 0, seen = 0;
  const auto compare = [&](const Points& from, const Points& to, const Points& p, double sine2) {
    const Sharpness s =
        sharpness(boundary_triangles(four(from), four(to), four(p)), {sine2, 1e300});
    for (std::size_t k = 0; k < 4; ++k) {
      if (orient2d(from[k], to[k], p[k]) <= 0) continue;
      ++seen;
      const bool is_sharp = shape_of(from[k], to[k], p[k], {sine2, 0}).is_sharp;
      if (s.is_unsure[k] != 0) {
        ++unsure;
        continue;
      }
      sharp += is_sharp ? 1 : 0;
      ASSERT_EQ(s.is_sharp[k] != 0, is_sharp);
    }
  };
  for (int round = 0; round < 200'000; ++round) {
    const double sine = std::sin((20 + round % 20) * std::numbers::pi / 180);
    const std::int32_t extent = round % 2 == 0 ? 40 : kMaxBoundaryOffset - 1;
    compare(random.points(extent), random.points(extent), random.points(extent), sine * sine);
  }
  EXPECT_GT(seen, 300'000);
  EXPECT_GT(sharp, seen / 2);
  EXPECT_LT(unsure, seen / 1'000);
  // The limit is the angle of one triangle of each four itself, to the last digit and beside it.
  unsure = 0;
  for (int round = 0; round < 20'000; ++round) {
    const Points from = random.points(4'000), to = random.points(4'000), p = random.points(4'000);
    const auto area = static_cast<double>(orient2d(from[0], to[0], p[0]));
    const auto ab2 = static_cast<double>(distance2(from[0], to[0])),
               pa2 = static_cast<double>(distance2(from[0], p[0])),
               pb2 = static_cast<double>(distance2(to[0], p[0]));
    if (area <= 0) continue;
    const double sine2 = area * area / std::max({ab2 * pa2, pa2 * pb2, pb2 * ab2});
    for (const double off : {0.0, 1e-16, -1e-16, 1e-9, -1e-9, 3e-7, -3e-7, 3e-6, -3e-6})
      compare(from, to, p, sine2 * (1 + off));
  }
  EXPECT_GT(unsure, 10'000);
}

TEST(BoundaryTriangles, LargestAreasAreWholeNumbers) {
  EXPECT_EQ(QuickShapeLimits(0.25, 7.9).doubled_area[0], 7);
  EXPECT_EQ(QuickShapeLimits(0.25, 7.0).doubled_area[3], 7);
  EXPECT_EQ(QuickShapeLimits(0.25, 1e300).doubled_area[1], 1 << 30);
}

}  // namespace
}  // namespace trocar::pipeline
