// SPDX-License-Identifier: Apache-2.0
// Cortical walls that are thinner than a slice (cortical_wall.h), tick by tick in the law `cutting`.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <numbers>
#include <string>
#include <vector>

#include "tests/runtime/haptics/bone/dry_run.h"
#include "tests/support/body_fixture.h"

namespace trocar::runtime {
namespace {

using test::body_scene;
using test::kHexagon_m2;
using test::spaced_asset;

// The same body in slices of several thicknesses: cancellous bone with a texture, and a wall of cortical bone that
// thick slices average with it.
TEST(WallContact, AWallHasItsStrengthInSlicesThatAreThickerThanTheWall) {
  Scene scene = body_scene(0, 0, 0.12);
  scene.tissue.cut = CutTissue{};
  scene.tissue.cut->bone = BoneByHu{"kopperdahl-linear", "qct", 8e-4, 0, false};
  scene.tissue.stiffness_N_per_m = 2e6;
  const auto N = [](double hu) { return (-0.75 + 24.9 * 8e-4 * hu) * 1e6 * kHexagon_m2; };
  constexpr double kHeight_mm = 24, kStep_mm = 0.01;
  for (const double wall_mm : {0.5, 0.8, 1.2, 2.0}) {
    const auto hu_at = [&](double depth_mm) {
      return depth_mm < wall_mm || depth_mm > kHeight_mm - wall_mm
                 ? 1200
                 : 250 + 40 * std::sin(2 * std::numbers::pi * depth_mm / 8);
    };
    for (const double spacing_mm : {0.5, 1.0, 2.0}) {
      const int slices = static_cast<int>(kHeight_mm / spacing_mm);
      std::vector<double> hu(static_cast<std::size_t>(slices));
      for (int i = 0; i < slices; ++i) {  // index 0 is the lowest
        const int samples = static_cast<int>(std::lround(spacing_mm / kStep_mm));
        for (int k = 0; k < samples; ++k)
          hu[static_cast<std::size_t>(slices - 1 - i)] +=
              hu_at(i * spacing_mm + (k + 0.5) * kStep_mm) / samples;
      }
      scene.body->to = slices - 1;
      DryRun trial(scene, spaced_asset(slices, spacing_mm, hu));
      const double top_m = -trial.bone_.sheets.front().top_m;
      double entry_N = 0, exit_N = 0, plateau_N = 0, least_N = 1e9;
      int inside = 0;
      for (int step = 0; step < 1350; ++step) {
        const double way_m = -1e-3 + 20e-6 * step;
        trial.tick(0, top_m - way_m);
        const double depth_mm = 1e3 * (trial.state_.result.front_m + top_m),
                     tip_N = trial.state_.result.tip_N;
        if (!std::isfinite(depth_mm) || !(tip_N > 0)) continue;
        if (depth_mm < 3) entry_N = std::max(entry_N, tip_N);
        if (depth_mm > kHeight_mm - 3) exit_N = std::max(exit_N, tip_N);
        if (depth_mm < 4 || depth_mm > kHeight_mm - 4) continue;
        plateau_N += tip_N / N(hu_at(depth_mm));
        least_N = std::min(least_N, tip_N / N(hu_at(depth_mm)));
        ++inside;
      }
      const std::string where =
          std::to_string(wall_mm) + " mm in slices of " + std::to_string(spacing_mm);
      std::printf("wall of %s: entry %.3f, exit %.3f, plateau %.3f, least %.3f of the truth\n",
                  where.c_str(), entry_N / N(1200), exit_N / N(1200), plateau_N / inside, least_N);
      EXPECT_NEAR(entry_N / N(1200), 1, 0.08) << where;
      EXPECT_NEAR(exit_N / N(1200), 1, 0.08) << where;
      EXPECT_NEAR(plateau_N / inside, 1, 0.03) << where;
      EXPECT_GT(least_N, 0.8) << where;
    }
  }
}

// A scene can say that the strength follows the HU of each slice.
TEST(WallContact, WithoutCortexHuTheStrengthIsThatOfTheSlice) {
  Scene scene = body_scene(0, 4, 0.12);
  scene.tissue.cut = CutTissue{};
  scene.tissue.cut->bone = BoneByHu{"kopperdahl-linear", "qct", 8e-4, 0, false};
  for (const double cortex_HU : {0.0, 1000.0}) {
    scene.body->cortex_HU = cortex_HU;
    DryRun trial(scene, spaced_asset(5, 2, {250, 250, 250, 250, 820}));
    trial.move(0, 0.122, 0, 0.1215);
    const CuttingSlab& first = trial.state_.slabs[0];
    EXPECT_EQ(first.upper_wall_to_m > first.top_m, cortex_HU > 0);
    EXPECT_EQ(first.lower_wall_from_m, std::numeric_limits<double>::infinity());
  }
}

}  // namespace
}  // namespace trocar::runtime
