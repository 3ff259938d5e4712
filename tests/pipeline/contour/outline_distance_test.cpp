// SPDX-License-Identifier: GPL-3.0-or-later
// Laws of outline_distance_mm(): never further than the accuracy from a dense sampling.
#include "pipeline/contour/outline_distance.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

namespace trocar::pipeline {
namespace {

constexpr double kAccuracy = 1e-3;

using Outline = std::vector<OutlineRing>;

OutlineRing square(double x, double y, double side) {
  return {{x, y}, {x + side, y}, {x + side, y + side}, {x, y + side}};
}

// One-sided, by points 1/200 mm apart or nearer.
double sampled(const Outline& from, const Outline& to) {
  double worst2 = 0;
  for (const OutlineRing& ring : from) {
    for (std::size_t i = 0; i < ring.size(); ++i) {
      const Point a = ring[i], b = ring[(i + 1) % ring.size()];
      const int steps = 1 + static_cast<int>(std::sqrt(distance2_between(a, b)) * 200);
      for (int k = 0; k <= steps; ++k) {
        const double t = static_cast<double>(k) / steps;
        const Point p{a.x + t * (b.x - a.x), a.y + t * (b.y - a.y)};
        double nearest2 = 1e30;
        for (const OutlineRing& other : to) {
          for (std::size_t j = 0; j < other.size(); ++j) {
            nearest2 =
                std::min(nearest2, segment_distance2(other[j], other[(j + 1) % other.size()], p));
          }
        }
        worst2 = std::max(worst2, nearest2);
      }
    }
  }
  return std::sqrt(worst2);
}

TEST(OutlineDistance, OfNothing) {
  const Outline a{square(0, 0, 10)}, none;
  EXPECT_EQ(outline_distance_mm(none, none), 0);
  EXPECT_TRUE(std::isinf(outline_distance_mm(a, none)));
  EXPECT_TRUE(std::isinf(outline_distance_mm(none, a)));
}

TEST(OutlineDistance, AgreesWithSampling) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> place(-8, 8), radius(0.5, 4);
  const auto outline = [&] {
    Outline out(1 + random() % 4);
    for (OutlineRing& ring : out) {
      const double x = place(random), y = place(random);
      const int points = 3 + static_cast<int>(random() % 30);
      for (int i = 0; i < points; ++i) {
        const double angle = 2 * M_PI * i / points, r = radius(random);
        ring.push_back({x + r * std::cos(angle), y + r * std::sin(angle)});
      }
    }
    return out;
  };
  for (int k = 0; k < 25; ++k) {
    const auto a = outline(), b = outline();
    const double found = outline_distance_mm(a, b, kAccuracy);
    const double wanted = std::max(sampled(a, b), sampled(b, a));
    EXPECT_GE(found, wanted - kAccuracy) << "case " << k;
    EXPECT_LE(found, wanted + 0.5 / 200 + 1e-9) << "case " << k;
    EXPECT_NEAR(outline_distance_mm(b, a, kAccuracy), found, kAccuracy) << "case " << k;
  }
}

}  // namespace
}  // namespace trocar::pipeline
