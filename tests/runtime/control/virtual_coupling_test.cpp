// SPDX-License-Identifier: Apache-2.0
// The virtual coupling: in the loop, compared with springs in series.
#include "runtime/control/virtual_coupling.h"

#include <gtest/gtest.h>

#include "tests/support/loop_rig.h"

namespace trocar::runtime {
namespace {

test::RigOptions coupled(double stiffness_N_per_m) {
  test::RigOptions options;
  options.hand_damping_N_s_per_m = 30;
  options.coupling.on = true;
  options.coupling.stiffness_N_per_m = stiffness_N_per_m;
  return options;
}

TEST(VirtualCoupling, InFreeSpaceTheProxyIsTheTool) {
  CouplingOptions options;
  CouplingState state;
  for (int i = 0; i < 100; ++i) {
    Pose pose;
    pose.p_m = {1e-3 * i, 0, 0.1};
    EXPECT_EQ(move_proxy(options, 1e-3, pose, state).p_m, pose.p_m);
    EXPECT_EQ(coupling_wrench(options, {}, state).norm(), 0);
  }
}

TEST(VirtualCoupling, AtRestTheForceIsThatOfSpringsInSeries) {
  for (const double sheet : {5000.0, 50000.0, 1e6}) {
    for (const double spring : {3000.0, 10000.0}) {
      test::RigOptions options = coupled(spring);
      options.tissue.stiffness_N_per_m = sheet;
      test::Rig rig(options);
      rig.run_until(2.5);
      const double depth_m = test::kRigSheet_m - rig.state_.T_device_plate.p_m.z();
      const double force_N = rig.result_.row.wrench_wanted[2];
      EXPECT_NEAR(force_N, depth_m / (1 / sheet + 1 / spring), 0.01 * force_N) << sheet;
      EXPECT_NEAR(rig.result_.contact.force_N, force_N, 0.01 * force_N) << "the sheet's";
      EXPECT_LT(rig.run_until(2.6), 0.1e-3) << sheet << ": stable, however stiff the sheet";
    }
  }
}

// The hand moves down at a constant speed into a sheet that damps more than the coupling: the force
// is that of the springs in series and of the dampers at their share of the speed.
TEST(VirtualCoupling, ADamperInTheSheetAddsItsOwnForceOnly) {
  constexpr double kSheet_N_per_m = 5000, kSpring_N_per_m = 10000, kSpeed_m_per_s = 0.01;
  const double share = kSpring_N_per_m / (kSpring_N_per_m + kSheet_N_per_m);
  for (const double damping : {0.0, 5.0, 40.0, 400.0}) {
    CouplingOptions options;
    options.stiffness_N_per_m = kSpring_N_per_m;
    CouplingState state;
    double last_depth_m = 0;
    for (int i = 1; i < 1000; ++i) {
      Pose tool;
      tool.p_m.z() = -kSpeed_m_per_s * 1e-3 * i;
      ProxyEnvironment sheet;
      const double depth_m = -move_proxy(options, 1e-3, tool, state).p_m.z();
      sheet.stiffness_N_per_m = kSheet_N_per_m;
      sheet.damping_N_s_per_m = damping;
      if (i > 1)
        sheet.rate_m_per_s = (depth_m - last_depth_m) / 1e-3;  // as in a contact's first tick
      sheet.wrench_device[2] =
          std::max(0.0, kSheet_N_per_m * depth_m + damping * sheet.rate_m_per_s);
      last_depth_m = depth_m;
      const double felt_N = coupling_wrench(options, sheet, state)[2];
      if (i == 1) continue;  // the coupling acts from the next tick on
      ASSERT_NEAR(felt_N, sheet.wrench_device[2], 1e-6 * felt_N) << damping << ", " << i;
      if (i < 500) continue;
      // Once the proxy follows at its share of the speed: k x + b x' = K (z - x) + B (z' - x').
      const double rate = share * kSpeed_m_per_s;
      const double x_m = (kSpring_N_per_m * -tool.p_m.z() +
                          options.damping_N_s_per_m * (kSpeed_m_per_s - rate) - damping * rate) /
                         (kSpring_N_per_m + kSheet_N_per_m);
      ASSERT_NEAR(felt_N, kSheet_N_per_m * x_m + damping * rate, 1e-6 * felt_N) << damping;
    }
  }
}

// The same in the loop: a sheet is punctured when the force of its spring and damper reaches the
// threshold, not before.
TEST(VirtualCoupling, ASheetWithDampingIsPuncturedAtItsThreshold) {
  for (const double damping : {0.0, 40.0, 200.0}) {
    test::RigOptions options = coupled(10000);
    options.tissue.threshold_N = 25;
    options.tissue.damping_N_s_per_m = damping;
    options.pressed_N = 30;
    test::Rig rig(options);
    double last_N = 0;
    bool punctured = false;
    for (int i = 0; i < 1500 && !punctured; ++i) {
      const TickResult& result = rig.tick();
      punctured = result.contact.punctured_now;
      if (punctured) break;
      last_N = result.row.wrench_wanted[2];
    }
    ASSERT_TRUE(punctured) << damping;
    EXPECT_NEAR(last_N, 25, 1) << damping;
    EXPECT_LT(rig.result_.contact.judged_force_N, 26) << damping;
  }
}

TEST(VirtualCoupling, APunctureReleasesTheCouplingInTheSameTick) {
  test::RigOptions options = coupled(10000);
  options.tissue.threshold_N = 25;
  options.pressed_N = 30;
  test::Rig rig(options);
  double last_N = 0;
  for (int i = 0; i < 1500; ++i) {
    const TickResult& result = rig.tick();
    if (result.contact.punctured_now) {
      EXPECT_NEAR(last_N, 25, 1);
      EXPECT_EQ(result.row.wrench_wanted[2], 0);
      EXPECT_EQ(rig.state_.tau_motor_Nm.norm(), 0);
      return;
    }
    EXPECT_GE(result.row.wrench_wanted[2], 0) << "never pulls";
    last_N = result.row.wrench_wanted[2];
  }
  FAIL() << "not punctured";
}

}  // namespace
}  // namespace trocar::runtime
