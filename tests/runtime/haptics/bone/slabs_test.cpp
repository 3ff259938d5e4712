// SPDX-License-Identifier: Apache-2.0
// What a body feels like does not depend on where its slices fall.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>

#include "runtime/haptics/bone/bone_volume.h"
#include "tests/runtime/haptics/bone/cutting_fixture.h"
#include "tests/support/body_slabs.h"

namespace trocar::runtime {
namespace {

// Slices at a spacing, the first slab beginning at `from`; each has the mean of its slab.
template <class Mean>
std::vector<BodySlice> slices_of(double from, double to, double spacing, Mean mean) {
  std::vector<BodySlice> slices;
  const auto count = static_cast<int>(std::ceil((to - from) / spacing - 1e-6));
  for (int i = 0; i < count; ++i) {
    const double top = from + i * spacing;
    slices.push_back({.depth_m = top + spacing / 2, .strength_N = mean(top, top + spacing)});
  }
  return slices;
}

// Cancellous bone of 15 N whose strength varies by 20 % over a wavelength.
constexpr double kMean_N = 15, kVaries = 0.2;
double texture(double depth, double wave) {
  return kMean_N * (1 + kVaries * std::sin(2 * std::numbers::pi * depth / wave));
}
double texture_mean(double a, double b, double wave) {
  const double k = 2 * std::numbers::pi / wave;
  return kMean_N * (1 + kVaries * (std::cos(k * a) - std::cos(k * b)) / (k * (b - a)));
}

TEST(Slabs, CoverTheBodyAndKeepMeans) {
  const std::vector<BodySlice> slices{{.depth_m = 0.001, .strength_N = 10},
                                      {.depth_m = 0.002, .strength_N = 20},
                                      {.depth_m = 0.004, .strength_N = 1}};
  const std::vector<CuttingSlab> slabs = make_slabs(slices, {}, 1e-5);
  ASSERT_EQ(slabs.size(), 3U);
  EXPECT_DOUBLE_EQ(slabs[0].top_m, 0.0005);
  EXPECT_DOUBLE_EQ(slabs[0].bottom_m, 0.0015);
  EXPECT_DOUBLE_EQ(slabs[1].bottom_m, 0.003);
  EXPECT_DOUBLE_EQ(slabs[2].bottom_m, 0.005);
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_DOUBLE_EQ((slabs[i].strength_top_N + slabs[i].strength_bottom_N) / 2,
                     slices[i].strength_N);
    EXPECT_GE(slabs[i].strength_bottom_N, 0);
    EXPECT_DOUBLE_EQ(slabs[i].clearance_m, 1e-5);
  }
  EXPECT_DOUBLE_EQ(slabs[0].strength_bottom_N, 10) << "the first slab is constant";
  // The line through its neighbours falls by 4.5 N over its 1.5 mm; 21 N is 5 % above the largest.
  EXPECT_DOUBLE_EQ(slabs[1].strength_top_N, 21);
  EXPECT_DOUBLE_EQ(slabs[1].strength_bottom_N, 19);
  EXPECT_DOUBLE_EQ(slabs[2].strength_bottom_N, 1) << "the last slab is constant";
}

// The slope is that of the neighbours' line unless an end would exceed both its own and the neighbour's
// strength by more than 5 % of its own.
TEST(Slabs, TheSlopeIsLimitedByTheNeighbours) {
  const auto slope = [](double above_N, double own_N, double below_N) {
    const auto [top_N, bottom_N] = strength_ends(own_N, above_N, 1e-3, below_N, 1e-3, 1e-3);
    EXPECT_DOUBLE_EQ((top_N + bottom_N) / 2, own_N);
    EXPECT_GE(std::min(top_N, bottom_N), 0);
    return bottom_N - top_N;
  };
  EXPECT_DOUBLE_EQ(slope(10, 20, 30), 10) << "a straight line is kept";
  EXPECT_DOUBLE_EQ(slope(30, 20, 10), -10);
  EXPECT_DOUBLE_EQ(slope(10, 12, 40), 2 * (2 + 0.6)) << "the top is at least 0.95 of 12 below 10";
  EXPECT_DOUBLE_EQ(slope(40, 12, 10), -2 * (2 + 0.6));
  EXPECT_DOUBLE_EQ(slope(10, 38, 40), 2 * (2 + 1.9));
  EXPECT_DOUBLE_EQ(slope(10, 40, 12), 1) << "a symmetrical peak has the slope of the line";
  EXPECT_DOUBLE_EQ(slope(10, 40, 38), 2 * 2) << "a peak: at most 5 % above it";
  EXPECT_DOUBLE_EQ(slope(0, 0, 40), 0) << "no strength, no slope";
  EXPECT_DOUBLE_EQ(slope(60, 10, 0.1), -20) << "the bottom has no strength, not a negative one";
  EXPECT_DOUBLE_EQ(slope(0.1, 10, 60), 20);
}

TEST(Slabs, RefusesDisorder) {
  const std::vector<BodySlice> slices{{.depth_m = 0.002}, {.depth_m = 0.001}};
  EXPECT_THROW(make_slabs(slices, {}, 0), std::invalid_argument);
  const std::vector<BodySlice> good{{.depth_m = 0.001}, {.depth_m = 0.002}};
  const std::vector<BodyShell> two{{0.001, 0.001, 50}, {0.0015, 0.001, 50}};
  EXPECT_THROW(make_slabs(good, two, 0), std::invalid_argument);
  EXPECT_TRUE(make_slabs(std::span(good).first(1), {}, 0).empty());
}

// Force over depth within 3 %, work within 1.5 % of the texture itself, wherever the slices begin.
TEST(Slabs, SpacingDoesNotShow) {
  constexpr double kWave = 0.012, kEnd = 0.036;
  double worst_force = 0, worst_work = 0;
  for (const double spacing : {5e-4, 1e-3, 2e-3}) {
    for (int shift = 0; shift < 5; ++shift) {
      const double from = -spacing * shift / 5;
      Bench b(make_slabs(slices_of(from, kEnd, spacing,
                                   [](double x, double y) { return texture_mean(x, y, kWave); }),
                         {}, 0));
      b.options.coupling.translation_N_per_m = 1e5;
      b.options.tip_N_per_m = 1e5;
      double work = 0, expected = 0, last = b.slabs.front().top_m;
      b.move(plate_at(0, -0.002), plate_at(0, 0.035), 1e-5,
             [&](const CuttingResult& out, const Pose&) {
               // Not in the first and last slab, whose slope is one-sided.
               if (out.front_m < 0.003 || out.front_m > 0.032 || out.cut_J <= 0) return;
               const double Y = texture(out.front_m, kWave);
               worst_force = std::max(worst_force, std::abs(out.tip_N - Y) / Y);
               if (work > 0) {
                 work += out.cut_J;
                 expected += texture_mean(last, out.front_m, kWave) * (out.front_m - last);
               } else {
                 work = 1e-300;
               }
               last = out.front_m;
             });
      worst_work = std::max(worst_work, std::abs(work / expected - 1));
      EXPECT_GT(expected, 0.3);
    }
  }
  RecordProperty("worst_force", std::to_string(worst_force));
  RecordProperty("worst_work", std::to_string(worst_work));
  EXPECT_LE(worst_force, 0.03);
  EXPECT_GT(worst_force, 1e-3);  // or nothing was compared
  EXPECT_LE(worst_work, 0.015);
}

// A shell of 1.2 mm and 60 N over 15 N: the peak is the shell's however thick the slices are and
// wherever they fall, though their means hold only part of it.
TEST(Slabs, AShellsPeakDoesNotDependOnTheSlices) {
  constexpr BodyShell kShell{0.003, 1.2e-3, 60};
  const auto mean = [&](double a, double b) {
    const double end = kShell.top_m + kShell.thickness_m;
    const double in_shell = std::max(0.0, std::min(b, end) - std::max(a, kShell.top_m));
    return (in_shell * kShell.strength_N + std::max(0.0, b - std::max(a, end)) * 15) / (b - a);
  };
  for (const double spacing : {5e-4, 1e-3, 2e-3}) {
    for (int shift = 0; shift < 10; ++shift) {
      const double from = 0.003 - spacing * (1 + 0.1 * shift);
      std::vector<BodySlice> slices = slices_of(from, 0.02, spacing, mean);
      // Above the shell is air: a slice there says so.
      const std::vector<BodyShell> shells{kShell};
      std::vector<CuttingSlab> slabs = make_slabs(slices, shells, 0);
      std::erase_if(slabs,
                    [&](const CuttingSlab& s) { return s.bottom_m <= kShell.top_m + 1e-12; });
      Bench b(slabs);
      b.options.coupling.translation_N_per_m = 1e5;
      double peak = 0, after = 0, work = 0;
      b.move(plate_at(0, -0.002), plate_at(0, 0.018), 1e-5,
             [&](const CuttingResult& out, const Pose&) {
               peak = std::max(peak, out.tip_N);
               if (out.front_m > 0.003 + 1.2e-3 + 2e-3) after = std::max(after, out.tip_N);
               if (out.front_m <= 0.003 + 1.2e-3 + 1e-9) work += out.cut_J;
             });
      EXPECT_NEAR(peak, 60, 0.05 * 60) << spacing << " " << shift;
      EXPECT_NEAR(after, 15, 0.5) << spacing << " " << shift;
      EXPECT_NEAR(work, 60 * 1.2e-3, 0.05 * 60 * 1.2e-3) << spacing << " " << shift;
    }
  }
}

}  // namespace
}  // namespace trocar::runtime
