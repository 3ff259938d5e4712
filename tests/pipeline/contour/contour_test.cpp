// SPDX-License-Identifier: GPL-3.0-or-later
// Contours of shapes whose area is known and of noise; where they cross the lines of the pixel grid.
#include "pipeline/contour/contour.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <vector>

#include "formats/mesh/mesh_validity.h"
#include "tests/support/synthetic_fields.h"
#include "tests/support/uniform.h"

namespace trocar::pipeline {
namespace {

constexpr PixelGrid kUnit{1.0, 1.0, 0, 0, Lattice{8}};

double area_px(const Pslg& pslg) {
  return 0.5 * static_cast<double>(doubled_area(pslg)) / (256.0 * 256.0);
}

Field field_of(int width, int height, const std::string& pixels) {  // '#' is material
  Field field{{width, height, {}}, 0.5F};
  for (const char c : pixels)
    field.image.values.push_back(c == '#' ? 1.0F : 0.0F);
  return field;
}

// At 64 positions of the disc on the pixel grid, among them symmetric ones, where the errors of all
// four quadrants are equal.
TEST(SubpixelContour, AreaOfDiscsIsAccurate) {
  struct Case {
    double radius, worst;
  };
  for (const double blur_px : {0.0, 0.5, 1.0}) {
    for (const Case& c : {Case{20, 0.001}, Case{20.3, 0.001}, Case{5, 0.01}, Case{5.3, 0.01}}) {
      const int size = c.radius > 10 ? 64 : 24;
      const double exact = std::numbers::pi * c.radius * c.radius;
      for (int k = 0; k < 64; ++k) {
        const double centre = 0.5 * size;  // a whole number: both sizes are even
        const Field field = disc_field(size, centre + 0.125 * (k % 8), centre + 0.125 * (k >> 3),
                                       c.radius, blur_px);
        const Pslg rings = contours(field, kUnit, ContourKind::kSubpixel);
        ASSERT_EQ(rings.rings.size(), 1U);
        EXPECT_NEAR(area_px(rings) / exact, 1, c.worst)
            << "radius " << c.radius << " blur " << blur_px << " position " << k;
      }
    }
  }
}

TEST(Contours, DropSmallRingsDropsHolesAndIslands) {
  Pslg rings = contours(field_of(9, 9,
                                 "#########"
                                 "#########"
                                 "##.######"
                                 "#########"
                                 "####...##"
                                 "####...##"
                                 "####...##"
                                 "#########"
                                 "#########"),
                        kUnit, ContourKind::kSubpixel);
  EXPECT_EQ(rings.rings.size(), 3U);
  EXPECT_EQ(drop_small_rings(rings, 2.0, Lattice{8}).rings.size(), 2U);
  EXPECT_EQ(drop_small_rings(rings, 1000.0, Lattice{8}).rings.size(), 0U);
}

using trocar::test::uniform;

TEST(Crossing, IsExactOnLines) {
  std::mt19937_64 rng(1);
  for (int k = 0; k < 1000; ++k) {
    const double at = uniform(rng), rise = 100 * (uniform(rng) - 0.5);
    GridLine line;
    for (int i = 0; i < 8; ++i)
      line.value[static_cast<std::size_t>(i)] = rise * (i - 3 - at);
    for (const auto& [first, last] : {std::pair{0, 7}, {3, 4}, {2, 4}, {3, 5}}) {
      line.first = first;
      line.last = last;
      EXPECT_NEAR(crossing(line), at, 1e-9);
    }
  }
}

// The root of Steffen's interpolant in Hermite form, by bisection.
double by_bisection(const GridLine& line) {
  const auto& f = line.value;
  const auto sign = [](double s) { return s > 0 ? 1.0 : (s < 0 ? -1.0 : 0.0); };
  const auto tangent = [&](std::size_t i) {
    const double s = f[i] - f[i - 1], t = f[i + 1] - f[i];
    return (sign(s) + sign(t)) *
           std::min({std::abs(s), std::abs(t), 0.5 * std::abs(0.5 * (s + t))});
  };
  const double a = tangent(3), b = tangent(4);
  double low = 0, high = 1;
  for (int i = 0; i < 60; ++i) {
    const double t = 0.5 * (low + high), u = 1 - t;
    const double value =
        (1 + 2 * t) * u * u * f[3] + t * u * u * a + t * t * (3 - 2 * t) * f[4] - t * t * u * b;
    ((value >= 0) == (f[3] >= 0) ? low : high) = t;
  }
  return 0.5 * (low + high);
}

TEST(Crossing, IsTheRootOfTheMonotoneCubic) {
  std::mt19937_64 rng(2);
  for (int k = 0; k < 100000; ++k) {
    GridLine line;
    for (double& v : line.value) {
      v = std::pow(10, 4 * uniform(rng)) * (uniform(rng) - 0.5);
      if (rng() % 8 == 0) v = std::rint(v / 1000);  // many zeros
    }
    if ((line.value[3] >= 0) == (line.value[4] >= 0)) continue;
    const double t = crossing(line);
    ASSERT_GE(t, 0);
    ASSERT_LE(t, 1);
    // If the slope vanishes at the root, positions may differ although values do not.
    if (std::abs(t - by_bisection(line)) > 1e-4) {
      EXPECT_LT(std::min(std::abs(line.value[3]), std::abs(line.value[4])), 1e-9) << k;
    }
  }
}

// A pixel's value is the share of its area on the material's side of the edge u = at + slope * v.
TEST(Crossing, IsExactOnSharpStraightEdges) {
  std::mt19937_64 rng(3);
  for (int k = 0; k < 2000; ++k) {
    const double at = 3 + uniform(rng), slope = 3 * (uniform(rng) - 0.5);
    const double high = 100 + 1000 * uniform(rng);
    GridLine line;
    for (int i = 0; i < 8; ++i) {
      double share = 0;
      constexpr int kStrips = 2000;
      for (int j = 0; j < kStrips; ++j) {
        const double v = (j + 0.5) / kStrips - 0.5;
        share += std::clamp(at + slope * v - (i - 0.5), 0.0, 1.0) / kStrips;
      }
      line.value[static_cast<std::size_t>(i)] = high * (share < 1 - 1e-9 ? share : 1) - high / 2;
    }
    if ((line.value[3] >= 0) == (line.value[4] >= 0)) continue;  // at a grid point, by rounding
    EXPECT_NEAR(crossing(line), at - 3, 1e-5) << "slope " << slope;
  }
}

double area(const std::vector<Crossing>& ring) {
  double doubled = 0;
  const auto u = [](const Crossing& c) { return c.x + (c.along_v ? 0 : c.t); };
  const auto v = [](const Crossing& c) { return c.y + (c.along_v ? c.t : 0); };
  for (std::size_t i = 0; i < ring.size(); ++i) {
    const Crossing &a = ring[i], &b = ring[(i + 1) % ring.size()];
    doubled += u(a) * v(b) - u(b) * v(a);
  }
  return 0.5 * doubled;
}

// All points of a circle on the lines of the grid, in order.
std::vector<Crossing> circle(double cx, double cy, double radius) {
  std::vector<std::pair<double, Crossing>> found;
  const auto add = [&](double u, double v, bool along_v) {
    Crossing c{static_cast<int>(std::floor(u)), static_cast<int>(std::floor(v)), along_v, false, 0};
    (along_v ? c.x : c.y) = static_cast<int>(std::rint(along_v ? u : v));
    c.t = along_v ? v - c.y : u - c.x;
    found.emplace_back(std::atan2(v - cy, u - cx), c);
  };
  for (int i = 0; i < 64; ++i) {
    for (const double side : {-1.0, 1.0}) {
      if (std::abs(i - cx) < radius)
        add(i, cy + side * std::sqrt(radius * radius - (i - cx) * (i - cx)), true);
      if (std::abs(i - cy) < radius)
        add(cx + side * std::sqrt(radius * radius - (i - cy) * (i - cy)), i, false);
    }
  }
  std::sort(found.begin(), found.end(),
            [](const auto& a, const auto& b) { return a.first < b.first; });
  std::vector<Crossing> ring;
  ring.reserve(found.size());
  for (const auto& [angle, c] : found)
    ring.push_back(c);
  return ring;
}

TEST(Crossing, RestoresTheAreaOfACircleInBothOrientations) {
  std::mt19937_64 rng(4);
  for (const double radius : {4.0, 5.3, 12.0, 20.3}) {
    const double exact = std::numbers::pi * radius * radius;
    for (int k = 0; k < 100; ++k) {
      std::vector<Crossing> ring = circle(32 + uniform(rng), 32 + uniform(rng), radius);
      const double missing = 1 - area(ring) / exact;
      EXPECT_GT(missing, 0.1 / (radius * radius));
      const bool hole = k % 2 == 1;
      if (hole) std::reverse(ring.begin(), ring.end());
      restore_chord_areas(ring);
      EXPECT_LT(std::abs(1 - std::abs(area(ring)) / exact), 0.1 * missing) << radius;
    }
  }
}

TEST(Crossing, LeavesShortRingsAndBordersUnchanged) {
  std::vector<Crossing> border = circle(32.3, 31.6, 5.3);
  for (Crossing& c : border)
    c.fixed = true;
  const double before = area(border);
  restore_chord_areas(border);
  EXPECT_EQ(area(border), before);
  for (std::size_t n = 0; n < 4; ++n) {
    std::vector<Crossing> few(border.begin(), border.begin() + static_cast<std::ptrdiff_t>(n));
    restore_chord_areas(few);
    EXPECT_EQ(few.size(), n);
  }
}

}  // namespace
}  // namespace trocar::pipeline
