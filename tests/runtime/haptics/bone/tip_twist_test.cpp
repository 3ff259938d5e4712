// SPDX-License-Identifier: Apache-2.0
// The moment that turns a tip in what it cuts. Its energy is in cutting_energy_test.
#include <gtest/gtest.h>

#include <cmath>

#include "tests/runtime/haptics/bone/cutting_fixture.h"

namespace trocar::runtime {
namespace {

constexpr double kTurnRadius_m = 1.5e-3, kTurnPresliding_m = 1e-5, kTwist_Nm = 0.02;

Bench turned_bench(double torsion_Nm) {
  Bench b(even_slabs(10, 1e-3, 60));
  b.options.torsion_Nm = torsion_Nm;
  b.options.tip_presliding_m = kTurnPresliding_m;
  b.options.tool.radius_m = kTurnRadius_m;
  b.options.coupling.rotation_Nm_per_rad = 20;
  return b;
}

Pose turned_to(double angle, double depth_m) {
  Pose T;
  T.p_m = {0, 0, -depth_m};
  T.q = from_rotation_vector({0, 0, angle});
  return T;
}

TEST(TipTwist, TurningNeedsItsMomentAndTakesItsWork) {
  for (const double sense : {1.0, -1.0}) {
    Bench b = turned_bench(kTwist_Nm);
    b.move(plate_at(0, -0.001), plate_at(0, 0.02), 1e-5);
    ASSERT_GT(b.out.tip_N, 50);
    EXPECT_EQ(b.out.wrench_device[5], 0) << "nothing turns";
    double work_J = 0, before = 0;
    const double stored_J = b.out.stored_J;
    for (int k = 1; k <= 2000; ++k) {
      b.tick(turned_to(sense * 1e-3 * k, 0.02));
      const double moment_Nm = -sense * b.out.wrench_device[5];
      EXPECT_LE(moment_Nm, kTwist_Nm * (1 + 1e-9));
      work_J += 0.5 * (before + moment_Nm) * 1e-3;
      before = moment_Nm;
    }
    EXPECT_NEAR(before, kTwist_Nm, 1e-6);
    // The elastic parts turn by 1 mrad in the coupling and 7 mrad at the tip.
    EXPECT_NEAR(work_J - (b.out.stored_J - stored_J), kTwist_Nm * (2 - 1e-3 - 1e-5 / 1.5e-3), 1e-4);
  }
}

TEST(TipTwist, ATipWithoutLoadTurnsFreely) {
  Bench b = turned_bench(kTwist_Nm);
  b.move(plate_at(0, -0.01), plate_at(0, -0.002), 1e-5);
  b.tick(turned_to(0.5, -0.002));
  EXPECT_EQ(b.out.wrench_device.norm(), 0);
  Bench none = turned_bench(0);
  none.move(plate_at(0, -0.001), plate_at(0, 0.02), 1e-5);
  none.tick(turned_to(0.5, 0.02));
  EXPECT_NEAR(none.out.wrench_device[5], 0, 1e-9);
}

}  // namespace
}  // namespace trocar::runtime
