// SPDX-License-Identifier: Apache-2.0
// A bevelled tip is pushed to one side inside bone. Its energy is in cutting_energy_test.
#include <gtest/gtest.h>

#include <cmath>

#include "tests/runtime/haptics/bone/cutting_fixture.h"

namespace trocar::runtime {
namespace {

using Eigen::Vector3d;

constexpr double kBevelStrength_N = 60;

// A bevel whose face looks along +x, in bone of thin slabs.
Bench bevelled_bench(double ratio, double wall_N_per_m2 = 0, double wall_strength_N_per_m = 0) {
  Bench b(even_slabs(200, 1e-4, kBevelStrength_N));
  for (CuttingSlab& slab : b.slabs) {
    slab.wall_N_per_m2 = wall_N_per_m2;
    slab.wall_strength_N_per_m = wall_strength_N_per_m;
  }
  b.options.tool.bevel_plate = {ratio, 0, 0};
  b.options.tool.tip_plate_m = {0, 0, -0.1};
  b.options.coupling.translation_N_per_m = 100'000;
  b.options.coupling.rotation_Nm_per_rad = 1e3;
  return b;
}
Pose bevelled_tip_at(double x_m, double depth_m, double turn_rad = 0) {
  Pose T;
  T.q = from_rotation_vector({0, 0, turn_rad});
  T.p_m = {x_m, 0, 0.1 - depth_m};
  return T;
}
Vector3d bevelled_tip(const Bench& b) {
  return b.state.T_device_proxy * b.options.tool.tip_plate_m;
}

TEST(TipBevel, WithoutWallsThePlateFeelsTheWholeForceToTheSide) {
  for (const double ratio : {0.3, 0.8, 1.7}) {
    for (const double turn_rad : {0.0, 1.0}) {
      Bench b = bevelled_bench(ratio);
      b.options.tool.tip_plate_m.setZero();  // no lever, so the plate does not tilt
      Pose above = bevelled_tip_at(0, 0, turn_rad);
      above.p_m.z() = 1e-3;
      Pose inside = above;
      inside.p_m.z() = -8e-3;
      b.move(above, inside, 1e-5);
      const Wrench& w = b.out.wrench_device;
      ASSERT_NEAR(w[2], kBevelStrength_N, 0.1);
      EXPECT_NEAR(w[0] / w[2], -ratio * std::cos(turn_rad), 1e-4);
      EXPECT_NEAR(w[1] / w[2], -ratio * std::sin(turn_rad), 1e-4);
    }
  }
}

TEST(TipBevel, TheTipDriftsAwayFromTheFaceAndFartherWithEachMillimetre) {
  const auto drift_m = [](double ratio, double turn_rad, double depth_m) {
    Bench b = bevelled_bench(ratio, 2e8, 2e4);
    b.options.coupling.translation_N_per_m = 10'000;
    b.options.coupling.rotation_Nm_per_rad = 20;
    b.move(bevelled_tip_at(0, -1e-3, turn_rad), bevelled_tip_at(0, depth_m, turn_rad), 1e-5);
    return bevelled_tip(b);
  };
  EXPECT_NEAR(drift_m(0, 0, 15e-3).head<2>().norm(), 0, 1e-9);
  double before_m = 0;
  for (const double depth_m : {5e-3, 10e-3, 15e-3}) {
    const double x_m = drift_m(0.8, 0, depth_m).x();
    EXPECT_LT(x_m, before_m - 2e-5) << depth_m;
    EXPECT_NEAR(drift_m(0.8, std::acos(-1.0), depth_m).x(), -x_m, 1e-6) << "turned by half a turn";
    before_m = x_m;
  }
  EXPECT_LT(drift_m(1.2, 0, 15e-3).x(), before_m - 2e-5) << "a larger force drifts farther";
}

// While the tip drifts, the front moves with it between the ticks and passes slabs there.
TEST(TipBevel, ReportsEachSlabOnceHoweverFastTheTipDrifts) {
  for (const double step_m : {1e-6, 1e-5, 2e-4}) {
    Bench b = bevelled_bench(1.7, 1e6, 100);
    b.options.coupling.translation_N_per_m = 3'000;
    int next = 0;
    b.move(bevelled_tip_at(0, -1e-3), bevelled_tip_at(0, 15e-3), step_m,
           [&](const CuttingResult& out, const Pose&) {
             if (out.passed_from == out.passed_to) return;
             EXPECT_EQ(out.passed_from, next);
             next = out.passed_to;
           });
    EXPECT_GT(-bevelled_tip(b).x(), 1e-3);
    EXPECT_GT(next, 50);
    EXPECT_NEAR(next * 1e-4, b.out.front_m, 1e-4 + 1e-9);
  }
}

// Contract 7: work of cutting and of the walls together are the work of the hand.
TEST(TipBevel, TheSpringsEnergyDoesTheWorkOnTheWall) {
  for (const double ratio : {0.0, 0.8}) {
    Bench b = bevelled_bench(ratio, 2e7, 1e4);
    const Pose start = bevelled_tip_at(0, -1e-3);
    Pose before = start;
    b.tick(start);
    Wrench held = b.out.wrench_device;
    double hand_J = 0;
    b.move(start, bevelled_tip_at(0, 15e-3), 1e-6, [&](const CuttingResult& out, const Pose& X) {
      const Wrench mean = 0.5 * (held + out.wrench_device);
      hand_J -= mean.dot(displacement(before, X));
      held = out.wrench_device;
      before = X;
    });
    const double lost_J = hand_J - b.cut_J - b.out.stored_J;
    if (ratio > 0)
      EXPECT_GT(lost_J, 1e-4) << "walls have yielded";
    else
      EXPECT_NEAR(lost_J, 0, 1e-6);
    // The tip's path along the force, 1 along the shaft and -ratio to the side, times the strength. The shaft tilts
    // by some degrees.
    const Vector3d tip = bevelled_tip(b);
    EXPECT_NEAR(b.cut_J, kBevelStrength_N * (-tip.z() + ratio * tip.x() - b.state.stretch_m),
                5e-3 * b.cut_J);
  }
}

TEST(TipBevel, HasNoEffectOnASurface) {
  for (const double ratio : {0.0, 0.8}) {
    Bench b = bevelled_bench(ratio);
    b.options.slope = Eigen::Vector2d(0.2, 0);
    b.move(bevelled_tip_at(0, -1e-3), bevelled_tip_at(0, 5e-4), 1e-6);
    ASSERT_EQ(b.cut_J, 0);
    EXPECT_NEAR(b.out.wrench_device[0] / b.out.wrench_device[2], 0.2, 1e-6);
  }
}

}  // namespace
}  // namespace trocar::runtime
