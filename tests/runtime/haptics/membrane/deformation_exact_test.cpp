// SPDX-License-Identifier: Apache-2.0
// The exact solutions (tests/reference/deformation/disc.h, runtime/haptics/membrane/network.h)
// compared with each other and with their limits.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "runtime/haptics/membrane/network.h"
#include "tests/reference/deformation/disc.h"

namespace trocar::runtime {
namespace {

using Eigen::Vector2d;
constexpr double kPi = std::numbers::pi;

std::vector<Vector2d> regular(int sides, double circumradius, double turn = 0.1) {
  std::vector<Vector2d> out;
  for (int k = 0; k < sides; ++k) {
    const double angle = turn + 2 * kPi * k / sides;
    out.push_back(circumradius * Vector2d(std::cos(angle), std::sin(angle)));
  }
  return out;
}

double stiffness(const std::vector<Vector2d>& outline, double lambda, int panels = 16) {
  const auto found = unbounded_stiffness_per_foundation_m2(outline, lambda, panels);
  EXPECT_TRUE(found) << found.error().message;
  return found ? *found : 0;
}

TEST(Unbounded, AFinePolygonHasTheStiffnessOfItsDisc) {
  for (const double lambda : {0.0015, 0.008, 0.02}) {
    const Membrane unit{lambda * lambda, 1};
    const double a = 0.003;
    double last = 1;
    for (const int sides : {12, 24, 48}) {  // of the disc's area
      const double corner = a * std::sqrt(2 * kPi / sides / std::sin(2 * kPi / sides));
      const double error = std::abs(
          stiffness(regular(sides, corner), lambda, 6) / disc_stiffness_N_per_m(unit, a) - 1);
      EXPECT_LT(error, last / 6) << lambda << ", " << sides << " sides";
      last = error;
    }
    EXPECT_LT(last, 3e-5) << lambda;
  }
}

TEST(Unbounded, TheDefaultPanelsAreEnough) {
  for (const double lambda : {0.001, 0.005, 0.02, 0.3}) {
    const auto hexagon = regular(6, 0.003);
    EXPECT_NEAR(stiffness(hexagon, lambda) / stiffness(hexagon, lambda, 50), 1, 3e-5) << lambda;
  }
}

TEST(Unbounded, EquivalentRadiusOfAHexagon) {
  const double a = 0.003;
  const auto hexagon = regular(6, a);
  const auto ratio = [&](double lambda) {
    const auto radius = equivalent_radius_m(hexagon, lambda);
    EXPECT_TRUE(radius);
    return radius ? *radius / a : 0;
  };
  const double capacity =
      std::tgamma(1.0 / 6) / (std::pow(2.0, 4.0 / 3) * std::sqrt(kPi) * std::tgamma(2.0 / 3));
  const double equal_area = std::sqrt(1.5 * std::sqrt(3.0) / kPi);
  EXPECT_NEAR(ratio(10), capacity, 1e-4);
  EXPECT_NEAR(ratio(1.5 * a), capacity, 1e-3);
  EXPECT_NEAR(ratio(a / 1000), equal_area, 1e-3);
}

TEST(Unbounded, PlaceRotationAndFirstCornerDoNotMatter) {
  std::vector<Vector2d> outline{{0, 0}, {4, 0}, {4, 3}, {2, 1}, {0, 3}};  // not convex
  for (Vector2d& p : outline)
    p *= 0.001;
  const double found = stiffness(outline, 0.006);
  for (Vector2d& p : outline)
    p = Vector2d(0.05, -0.02) + Vector2d(0.6 * p.x() - 0.8 * p.y(), 0.8 * p.x() + 0.6 * p.y());
  std::rotate(outline.begin(), outline.begin() + 2, outline.end());
  EXPECT_NEAR(stiffness(outline, 0.006) / found, 1, 1e-9);
  // A larger tool is stiffer; the convex hull is only slightly stiffer than the concave tool.
  std::erase_if(outline,
                [](const Vector2d& p) { return (p - Vector2d(0.0504, -0.0178)).norm() < 1e-5; });
  ASSERT_EQ(outline.size(), 4U);
  EXPECT_GT(stiffness(outline, 0.006), found);
}

TEST(Unbounded, MembraneForToolHasTheStiffness) {
  const auto hexagon = regular(6, 0.003);
  const auto membrane = membrane_for_tool(5000, 0.008, hexagon);
  ASSERT_TRUE(membrane);
  EXPECT_NEAR(decay_length_m(*membrane), 0.008, 1e-12);
  EXPECT_NEAR(stiffness(hexagon, 0.008) * membrane->foundation_N_per_m3, 5000, 1e-9);
}

TEST(Unbounded, RefusesInvalidOutlines) {
  auto hexagon = regular(6, 0.003);
  EXPECT_FALSE(unbounded_stiffness_per_foundation_m2(hexagon, 0));
  EXPECT_FALSE(unbounded_stiffness_per_foundation_m2(hexagon, std::nan("")));
  EXPECT_FALSE(unbounded_stiffness_per_foundation_m2(hexagon, 0.01, 1));
  EXPECT_FALSE(unbounded_stiffness_per_foundation_m2(std::span(hexagon).first(2), 0.01));
  EXPECT_FALSE(unbounded_stiffness_per_foundation_m2({}, 0.01));
  hexagon[3] = hexagon[2];
  EXPECT_FALSE(unbounded_stiffness_per_foundation_m2(hexagon, 0.01));
  auto clockwise = regular(6, 0.003);
  std::reverse(clockwise.begin(), clockwise.end());
  EXPECT_FALSE(unbounded_stiffness_per_foundation_m2(clockwise, 0.01));
}

}  // namespace
}  // namespace trocar::runtime
