// SPDX-License-Identifier: Apache-2.0
// Crushed bone holds the tip when it is pulled back. The hold's energy is in cutting_energy_test.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "tests/runtime/haptics/bone/cutting_fixture.h"

namespace trocar::runtime {
namespace {

constexpr double kRadius_m = 1.5e-3, kPresliding_m = 1e-4;

Bench hold_bench(double tip_hold, std::vector<CuttingSlab> slabs) {
  Bench b(std::move(slabs));
  b.options.tip_hold = tip_hold;
  b.options.tip_presliding_m = kPresliding_m;
  b.options.tool.radius_m = kRadius_m;
  b.options.tip_N_per_m = 1e6;
  b.options.coupling.translation_N_per_m = 1e5;
  return b;
}

/// The force on the plate along z.
double pull_N(const Bench& b) {
  return b.out.wrench_device[2];
}

TEST(TipHold, ResistsWithdrawalWithItsFractionOfTheCrushingForce) {
  for (const double hold : {0.1, 0.25, 0.8}) {
    Bench b = hold_bench(hold, even_slabs(10, 1e-3, 60));
    b.move(plate_at(0, -0.001), plate_at(0, 0.005), 1e-6);
    ASSERT_NEAR(pull_N(b), 60, 1e-6) << "the hold does not resist advance";
    const double cut_J = b.cut_J, deepest_m = -b.state.T_device_proxy.p_m.z();
    double least_N = 60;
    b.move(plate_at(0, 0.005), plate_at(0, 0.002), 1e-6,
           [&](const CuttingResult& out, const Pose&) {
             least_N = std::min(least_N, out.wrench_device[2]);
             const double raised_m = deepest_m + b.state.T_device_proxy.p_m.z();
             if (raised_m < 2 * kPresliding_m) return;
             // Fades while the tip is raised by a diameter.
             const double limit_N = hold * 60 * std::max(0.0, 1 - raised_m / (2 * kRadius_m));
             EXPECT_NEAR(out.wrench_device[2], -limit_N, 0.02 * hold * 60) << raised_m;
           });
    EXPECT_NEAR(least_N, -hold * 60, 0.06 * hold * 60);
    EXPECT_EQ(b.cut_J, cut_J);
  }
}

TEST(TipHold, NoneIsNone) {
  Bench b = hold_bench(0, even_slabs(10, 1e-3, 60));
  b.move(plate_at(0, -0.001), plate_at(0, 0.005), 1e-5);
  double least_N = 60;
  b.move(plate_at(0, 0.005), plate_at(0, 0.002), 1e-5, [&](const CuttingResult& out, const Pose&) {
    least_N = std::min(least_N, out.wrench_device[2]);
  });
  EXPECT_GE(least_N, -1e-9);
}

// Behind a hard layer the force that is remembered falls to that of the soft bone, exponentially
// over a diameter of the tool.
TEST(TipHold, AHardLayerIsForgottenBehindIt) {
  std::vector<CuttingSlab> slabs = even_slabs(20, 1e-3, 10);
  slabs[0].strength_top_N = slabs[0].strength_bottom_N = 100;
  Bench b = hold_bench(0.5, slabs);
  b.move(plate_at(0, -0.001), plate_at(0, 0.018), 1e-6, [&](const CuttingResult& out, const Pose&) {
    if (out.front_m < 2e-3) return;
    EXPECT_NEAR(b.state.hold_tip_N, 10 + 90 * std::exp(-(out.front_m - 1e-3) / (2 * kRadius_m)),
                0.9);
  });
  EXPECT_NEAR(b.state.hold_tip_N, 10, 0.5);
}

// Behind the last bone no crushed bone is around the tip, whether there is more bone far below or
// not.
TEST(TipHold, ATipThatHasBrokenThroughIsNotHeld) {
  std::vector<CuttingSlab> slabs = even_slabs(10, 1e-3, 60);
  Bench last = hold_bench(0.25, slabs);
  slabs.push_back(slabs.back());
  slabs.back().top_m = 60e-3;
  slabs.back().bottom_m = 61e-3;
  Bench more = hold_bench(0.25, slabs);
  double most_N = 0, least_N = 0;
  for (int k = 0; k <= 1400; ++k) {
    // The plate goes to a depth of 11 mm, and back to 9 mm.
    const double depth_m = k <= 1200 ? -1e-3 + 1e-5 * k : 11e-3 - 1e-5 * (k - 1200);
    last.tick(plate_at(0, depth_m));
    more.tick(plate_at(0, depth_m));
    ASSERT_NEAR(pull_N(last), pull_N(more), 1e-5) << depth_m;
    most_N = std::max(most_N, pull_N(last));
    least_N = std::min(least_N, pull_N(last));
  }
  EXPECT_NEAR(most_N, 60, 1e-3);
  EXPECT_GE(least_N, -1e-5);
}

// Pushing again after a short withdrawal needs the whole force again, and the front goes on where
// it was.
TEST(TipHold, PushingAgainGoesOnFromTheSamePlace) {
  Bench b = hold_bench(0.25, even_slabs(10, 1e-3, 60));
  b.move(plate_at(0, -0.001), plate_at(0, 0.005), 1e-6);
  const double front_m = b.out.front_m, cut_J = b.cut_J;
  b.move(plate_at(0, 0.005), plate_at(0, 0.004), 1e-6);
  b.move(plate_at(0, 0.004), plate_at(0, 0.005), 1e-6);
  EXPECT_NEAR(b.out.front_m, front_m, 1e-8);
  EXPECT_NEAR(b.cut_J, cut_J, 1e-6);
  EXPECT_NEAR(pull_N(b), 60, 1e-3);
}

}  // namespace
}  // namespace trocar::runtime
