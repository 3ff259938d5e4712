// SPDX-License-Identifier: Apache-2.0
// Holes of the cutting law outlive withdrawal (contract 4 of cutting_law.h).
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "tests/runtime/haptics/bone/cutting_fixture.h"

namespace trocar::runtime {
namespace {

constexpr double kHoleStep = 5e-5;

Bench hole_bench(std::size_t holes = 4) {
  Bench b(even_slabs(20, 1e-3, 20), holes);
  for (CuttingSlab& slab : b.slabs) {
    slab.friction_N_per_m = 200;
    slab.wall_N_per_m2 = 1e7;
    slab.wall_strength_N_per_m = 1e6;
  }
  b.options.coupling.translation_N_per_m = 1e5;
  return b;
}

double push_to(Bench& b, double x, double depth) {
  double most = 0;
  b.move(plate_at(x, -0.002), plate_at(x, depth), kHoleStep,
         [&](const CuttingResult& out, const Pose&) { most = std::max(most, out.tip_N); });
  return most;
}
void pull_from(Bench& b, double x, double depth) {
  b.move(plate_at(x, depth), plate_at(x, -0.01), kHoleStep);
}

TEST(Hole, OutlivesWithdrawal) {
  Bench b = hole_bench();
  EXPECT_NEAR(push_to(b, 0, 0.015), 20, 1e-6);
  const double friction = b.out.wrench_device[2] - 20, depth = b.out.embedded_m, cut = b.cut_J;
  EXPECT_NEAR(friction, 200 * depth, 0.02 * friction);
  pull_from(b, 0, 0.015);
  EXPECT_EQ(b.out.embedded_m, 0);
  EXPECT_EQ(b.out.wrench_device.norm(), 0);
  EXPECT_LT(b.out.stored_J, 1e-18);

  // Again: no strength above the old bottom, but the friction and the walls of the hole.
  const double most = push_to(b, 0, 0.009);
  EXPECT_LT(most, 1e-9);
  EXPECT_EQ(b.cut_J, cut);
  EXPECT_NEAR(b.out.wrench_device[2], 200 * b.out.embedded_m, 0.02 * b.out.wrench_device[2]);
  EXPECT_GT(b.out.embedded_m, 0.008);
  b.move(plate_at(0, 0.009), plate_at(0.001, 0.009), kHoleStep);
  EXPECT_LT(b.out.wrench_device[0], -5);
  b.move(plate_at(0.001, 0.009), plate_at(0, 0.009), kHoleStep);

  // And at its bottom the bone.
  b.move(plate_at(0, 0.009), plate_at(0, 0.02), kHoleStep);
  EXPECT_NEAR(b.out.tip_N, 20, 1e-6);
  EXPECT_GT(b.cut_J, cut + 0.01 * 0.02);
}

TEST(Hole, AnotherPlaceIsAnotherHole) {
  Bench b = hole_bench();
  push_to(b, 0, 0.012);
  pull_from(b, 0, 0.012);
  EXPECT_NEAR(push_to(b, 0.005, 0.012), 20, 1e-6);
  EXPECT_NE(b.state.hole, -1);
  pull_from(b, 0.005, 0.012);
  const double cut = b.cut_J;
  for (const double x : {0.0, 0.005, 0.0}) {
    EXPECT_LT(push_to(b, x, 0.006), 1e-9) << x;
    EXPECT_GT(b.out.embedded_m, 0.005) << x;
    pull_from(b, x, 0.006);
  }
  EXPECT_EQ(b.cut_J, cut);
}

TEST(Hole, TheOldestIsForgotten) {
  Bench b = hole_bench(2);
  for (const double x : {0.0, 0.005, 0.01}) {
    EXPECT_NEAR(push_to(b, x, 0.01), 20, 1e-6);
    pull_from(b, x, 0.01);
  }
  EXPECT_LT(push_to(b, 0.005, 0.004), 1e-9);
  pull_from(b, 0.005, 0.004);
  EXPECT_NEAR(push_to(b, 0, 0.01), 20, 1e-6);
}

// A round tool of radius R beside an old hole of the same radius: the part of the tool outside it.
double share(double R, double e) {
  if (e >= 2 * R) return 1;
  const double lens = 2 * R * R * std::acos(e / (2 * R)) - e / 2 * std::sqrt(4 * R * R - e * e);
  return 1 - lens / (std::numbers::pi * R * R);
}

TEST(Hole, HalfOverAnOldOneCutsByItsShare) {
  EXPECT_NEAR(share(1.525e-3, 5e-4), 0.21, 0.005);
  EXPECT_NEAR(share(3e-3, 5e-4), 0.11, 0.005);
  for (const double e : {2e-4, 5e-4, 1e-3, 2e-3, 4e-3}) {
    Bench b = hole_bench();
    push_to(b, 0, 0.013);
    const double bottom = b.out.front_m;
    pull_from(b, 0, 0.013);
    const double before = b.cut_J;
    for (CuttingSlab& slab : b.slabs) {
      slab.share = share(1.525e-3, e);
      slab.share_to_m = bottom;
    }
    double to_bottom = 0;
    b.move(plate_at(e, -0.002), plate_at(e, 0.019), kHoleStep,
           [&](const CuttingResult& out, const Pose&) {
             if (out.front_m < bottom - 1e-9 && out.cut_J > 0) {
               EXPECT_NEAR(out.tip_N, 20 * share(1.525e-3, e), 1e-5);
               to_bottom = out.front_m;
             }
           });
    EXPECT_GT(to_bottom, bottom - 0.001);
    EXPECT_NEAR(b.out.tip_N, 20, 1e-5);
    EXPECT_NEAR(b.cut_J - before, 20 * (share(1.525e-3, e) * bottom + b.out.front_m - bottom),
                1e-8);
  }
}

TEST(Hole, WithinTheReachOfAHoleTheToolGoesIntoIt) {
  Bench b = hole_bench();
  push_to(b, 0, 0.012);
  pull_from(b, 0, 0.012);
  EXPECT_LT(push_to(b, 4e-5, 0.008), 1e-9);
  pull_from(b, 4e-5, 0.008);
  EXPECT_NEAR(push_to(b, 2e-4, 0.008), 20, 1e-6);
}

// Sheets of no thickness remember where they were passed.
TEST(Hole, OfASheet) {
  std::vector<CuttingSlab> sheets = even_slabs(3, 0, 35);
  for (std::size_t i = 0; i < 3; ++i)
    sheets[i].top_m = sheets[i].bottom_m = 0.02 * static_cast<double>(i);
  Bench b(sheets);
  b.options.coupling.is_rigid = true;
  b.options.tip_N_per_m = 5000;
  for (const double x : {0.0, 0.01}) {
    int peaks = 0;
    double before = 0;
    b.move(plate_at(x, -0.005), plate_at(x, 0.06), kHoleStep,
           [&](const CuttingResult& out, const Pose&) {
             peaks += before > 34 && out.tip_N == 0;
             before = out.tip_N;
           });
    EXPECT_EQ(peaks, 3) << x;
    b.move(plate_at(x, 0.06), plate_at(x, -0.005), kHoleStep);
    EXPECT_LT(push_to(b, x, 0.06), 1e-9) << x;
    b.move(plate_at(x, 0.06), plate_at(x, -0.005), kHoleStep);
  }
}

// Each slab is reported once for each hole through it, however many a tick passes.
TEST(Hole, PassedSlabsAreReportedOnce) {
  for (const double step : {2e-5, 1e-4, 3e-3}) {
    for (const double thickness : {1e-3, 0.0}) {
      Bench b = hole_bench();
      for (std::size_t i = 0; i < b.slabs.size(); ++i)
        b.slabs[i].bottom_m = b.slabs[i].top_m + thickness;
      for (const double x : {0.0, 0.005}) {
        std::vector<int> passed(b.slabs.size());
        int next = 0;
        const auto note = [&](const CuttingResult& out, const Pose&) {
          if (out.passed_from == out.passed_to) return;
          EXPECT_EQ(out.passed_from, next);
          next = out.passed_to;
          for (int i = out.passed_from; i < out.passed_to; ++i)
            ++passed[static_cast<std::size_t>(i)];
        };
        b.tick(plate_at(x, -0.002));
        b.move(plate_at(x, -0.002), plate_at(x, 0.008), step, note);
        b.move(plate_at(x, 0.008), plate_at(x, -0.002), step, note);  // out and in between
        b.move(plate_at(x, -0.002), plate_at(x, 0.03), step, note);
        b.move(plate_at(x, 0.03), plate_at(x, -0.01), step, note);
        b.move(plate_at(x, -0.002), plate_at(x, 0.03), step, note);
        b.move(plate_at(x, 0.03), plate_at(x, -0.01), step, note);
        EXPECT_EQ(passed, std::vector<int>(b.slabs.size(), 1)) << step << " " << thickness;
      }
    }
  }
}

// The sliver between a tool and an old hole 0.5 mm beside it breaks at its share, and shields
// nothing.
TEST(Hole, ASliverBreaksAtItsShare) {
  std::vector<CuttingSlab> sheets = even_slabs(3, 0, 35);
  for (std::size_t i = 0; i < 3; ++i)
    sheets[i].top_m = sheets[i].bottom_m = 0.02 * static_cast<double>(i);
  sheets[0].share = share(3e-3, 5e-4);
  Bench b(sheets);
  b.options.coupling.is_rigid = true;
  b.options.tip_N_per_m = 5000;
  std::vector<double> peaks{0};
  b.move(plate_at(0, -0.005), plate_at(0, 0.06), 1e-5, [&](const CuttingResult& out, const Pose&) {
    if (out.tip_N == 0 && peaks.back() > 0) peaks.push_back(0);
    peaks.back() = std::max(peaks.back(), out.tip_N);
  });
  ASSERT_EQ(peaks.size(), 4U);
  EXPECT_NEAR(peaks[0], 35 * share(3e-3, 5e-4), 0.05);
  EXPECT_NEAR(peaks[1], 35, 0.051);
  EXPECT_NEAR(peaks[2], 35, 0.051);
}

// Slanting from its old hole into whole bone, the tool cuts again where it leaves the hole.
TEST(Hole, LeftBySlanting) {
  Bench b = hole_bench();
  b.options.tool.tip_plate_m = {0, 0, -0.1};
  b.move(plate_at(0, -0.102), plate_at(0, -0.1 + 0.015), kHoleStep);
  b.move(plate_at(0, -0.1 + 0.015), plate_at(0, -0.102), kHoleStep);
  const double cut = b.cut_J;
  // 0.1 rad about the mouth of the hole.
  const auto slanting = [](double depth) {
    Pose X = plate_at(0, 0, 0.1);
    X.p_m = X.q * Eigen::Vector3d(0, 0, 0.1 - depth);
    return X;
  };
  double most = 0;
  b.move(slanting(-0.002), slanting(0.01), kHoleStep,
         [&](const CuttingResult& out, const Pose&) { most = std::max(most, out.tip_N); });
  EXPECT_NEAR(most, 20, 1e-3);
  EXPECT_GT(b.cut_J, cut + 20 * 0.005);
}

// Down beside the bone without force, then against it from outside: the wall holds the tool, yields
// at its strength, and has then been pushed in.
TEST(Hole, BoneIsAWallFromOutside) {
  Slot beside;  // all of x < 2 mm
  beside.open({-1, -1}, 0);
  for (const Eigen::Vector2d& corner : {Eigen::Vector2d(0.002, -1), {0.002, 1}, {-1, 1}})
    beside.include(corner);
  Bench b = hole_bench();
  b.options.coupling.rotation_Nm_per_rad = 1e4;
  for (CuttingSlab& slab : b.slabs) {
    slab.share = 0;
    slab.friction_N_per_m = 0;
    slab.wall_strength_N_per_m = 2000;
    slab.free = &beside;
    slab.free_version = 1;
  }
  b.move(plate_at(0, -0.002), plate_at(0, 0.01), kHoleStep,
         [](const CuttingResult& out, const Pose&) { ASSERT_LT(out.wrench_device.norm(), 1e-12); });
  b.move(plate_at(0, 0.01), plate_at(0.0019, 0.01), kHoleStep);
  EXPECT_LT(b.out.wrench_device.norm(), 1e-12);
  double before = 0;
  b.move(plate_at(0.0019, 0.01), plate_at(0.004, 0.01), 1e-5,
         [&](const CuttingResult& out, const Pose&) {
           EXPECT_GE(-out.wrench_device[0], before - 1e-5);  // never through bone without force
           before = -out.wrench_device[0];
         });
  EXPECT_NEAR(before, 2000 * 0.01, 0.02 * 20);
  const double pushed = b.state.T_device_proxy.p_m.x();
  EXPECT_GT(pushed, 0.003);

  // A new outline from the geometry, without what was pushed in: no energy comes with it.
  const double stored = b.out.stored_J;
  for (CuttingSlab& slab : b.slabs)
    slab.free_version = 2;
  b.tick(plate_at(0.004, 0.01));
  EXPECT_LE(b.out.stored_J, stored + 1e-12);
  EXPECT_NEAR(-b.out.wrench_device[0], before, 0.01 * before);
}

}  // namespace
}  // namespace trocar::runtime
