// SPDX-License-Identifier: Apache-2.0
// The raster of distances to an outline against the distance to each edge in turn.
#include "runtime/haptics/sheet.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "formats/mesh/lattice.h"
#include "tests/support/counted_allocations.h"
#include "tests/support/random_geometry.h"

namespace trocar::runtime {
namespace {

using Eigen::Vector2d;

constexpr double kLattice_mm = 1.0 / 256, kReach_mm = EdgeDistance::kReach_mm;

/// Distance to the nearest edge, positive inside; inside by the sum of the angles.
double by_edges(const Pslg& outline, const Vector2d& p_mm) {
  double nearest_mm = kReach_mm, turns = 0;
  for (const Ring& ring : outline.rings) {
    for (std::size_t i = 0; i < ring.size(); ++i) {
      const LatticePoint from = ring[i], to = ring[(i + 1) % ring.size()];
      const Vector2d a = Vector2d(from.x, from.y) * kLattice_mm - p_mm,
                     b = Vector2d(to.x, to.y) * kLattice_mm - p_mm, ab = b - a;
      const double part = std::clamp(-a.dot(ab) / ab.squaredNorm(), 0.0, 1.0);
      nearest_mm = std::min(nearest_mm, (a + part * ab).norm());
      turns += std::atan2(a.x() * b.y() - a.y() * b.x(), a.dot(b));
    }
  }
  return turns > 3 ? nearest_mm : -nearest_mm;
}

PlanarTransform placed_at_angle(double angle) {
  PlanarTransform transform;
  transform.anchor_mm = {3.5, -2};
  transform.at_m = {0.004, 0.011};
  transform.cosine = std::cos(angle);
  transform.sine = std::sin(angle);
  return transform;
}

double distance_mm(const EdgeDistance& edge, const PlanarTransform& transform,
                   const Vector2d& p_mm) {
  return 1e3 * edge.at(transform, transform.to_scene(p_mm / kLattice_mm)).distance_m;
}

TEST(EdgeDistance, IsThatOfTheNearestEdge) {
  Random random(3);
  for (int trial = 0; trial < 10; ++trial) {
    Pslg outline{{star(random, {300 * trial, -200}, 1500, 3500, 12)}};
    Ring hole = star(random, {300 * trial, -200}, 300, 900, 7);
    std::reverse(hole.begin(), hole.end());
    outline.rings.push_back(hole);
    const PlanarTransform transform = placed_at_angle(0.7 * trial);
    const EdgeDistance edge(outline, transform.lattice);
    const LatticeBox box = box_around(std::span<const LatticePoint>(outline.rings[0]));
    const Vector2d corner_mm =
        Vector2d(box.low.x, box.low.y) * kLattice_mm - Vector2d::Constant(kReach_mm);
    for (int k = 0; k < 500; ++k) {
      const Vector2d node_mm =
          corner_mm +
          EdgeDistance::kSpacing_mm * Vector2d(random.between(0, 50), random.between(0, 50));
      ASSERT_NEAR(distance_mm(edge, transform, node_mm), by_edges(outline, node_mm), 1e-5);
    }
    int inside = 0, near = 0;
    for (int k = 0; k < 3000; ++k) {
      const Vector2d p_mm(300 * trial * kLattice_mm + 40 * (random.unit() - 0.5),
                          40 * (random.unit() - 0.5));
      const double wanted_mm = by_edges(outline, p_mm), got_mm = distance_mm(edge, transform, p_mm);
      // Bilinear between exact values of a function whose slope is at most 1.
      ASSERT_NEAR(got_mm, wanted_mm, EdgeDistance::kSpacing_mm)
          << trial << ": " << p_mm.transpose();
      inside += wanted_mm > 0;
      near += std::abs(wanted_mm) < kReach_mm;
    }
    EXPECT_GT(inside, 200);
    EXPECT_GT(near, 800);
  }
}

TEST(EdgeDistance, IsExactBesideAStraightEdgeInEveryDirection) {
  const int size = 40 * 256;
  const EdgeDistance edge({{{{-size, -size}, {size, -size}, {size, size}, {-size, size}}}},
                          Lattice{});
  Random random(4);
  for (int k = 0; k < 500; ++k) {
    const PlanarTransform transform = placed_at_angle(6.3 * random.unit());
    const Vector2d p_mm(40 + 3.4 * (2 * random.unit() - 1), 30 * (2 * random.unit() - 1));
    const EdgeDistance::Sample got = edge.at(transform, transform.to_scene(p_mm / kLattice_mm));
    ASSERT_NEAR(1e3 * got.distance_m, 40 - p_mm.x(), 1e-5);
    ASSERT_NEAR((got.gradient - Vector2d(-transform.cosine, -transform.sine)).norm(), 0, 1e-5);
  }
}

TEST(EdgeDistance, IsLimitedFarFromTheEdgeAndOutside) {
  const EdgeDistance edge({{{{0, 0}, {12 * 256, 0}, {12 * 256, 12 * 256}, {0, 12 * 256}}}},
                          Lattice{});
  const PlanarTransform plain;
  EXPECT_EQ(distance_mm(edge, plain, {6, 6}), kReach_mm);
  EXPECT_EQ(distance_mm(edge, plain, {200, 6}), -kReach_mm);
  EXPECT_EQ(distance_mm(edge, plain, {6, -1e9}), -kReach_mm);
  EXPECT_EQ(distance_mm(EdgeDistance(), plain, {0, 0}), -kReach_mm);
  EXPECT_EQ(distance_mm(EdgeDistance(Pslg{}, Lattice{}), plain, {0, 0}), -kReach_mm);
  EXPECT_EQ(edge.at(plain, {0.2, 0.006}).gradient.norm(), 0);
}

TEST(EdgeDistance, AWideSliceHasACoarserRaster) {
  const int size = 500 * 256;
  const EdgeDistance edge({{{{0, 0}, {size, 0}, {size, size}, {0, size}}}}, Lattice{});
  EXPECT_NEAR(distance_mm(edge, PlanarTransform{}, {2, 250}), 2, 1e-4);
}

TEST(EdgeDistance, ReadsWithoutAllocation) {
  TROCAR_NEEDS_COUNTED_ALLOCATIONS();
  const EdgeDistance edge({{{{0, 0}, {2560, 0}, {2560, 2560}, {0, 2560}}}}, Lattice{});
  const PlanarTransform plain;
  const std::uint64_t before = allocations_in_scopes();
  double sum = 0;
  {
    const NoAllocationScope scope;
    for (int k = 0; k < 1000; ++k)
      sum += edge.at(plain, {1e-5 * k, 0.002}).distance_m;
  }
  EXPECT_NE(sum, 0);
  EXPECT_EQ(allocations_in_scopes(), before);
}

}  // namespace
}  // namespace trocar::runtime
