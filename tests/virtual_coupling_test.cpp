// SPDX-License-Identifier: Apache-2.0
// The virtual coupling's laws: in the loop, against the springs in series that it must be.
#include "runtime/loop/virtual_coupling.h"

#include <gtest/gtest.h>

#include "tests/loop_rig.h"

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
    EXPECT_EQ(felt_wrench(options, Wrench::Zero(), 0, state).norm(), 0);
  }
}

TEST(VirtualCoupling, AtRestItIsASpringInSeries) {
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

TEST(VirtualCoupling, APunctureLetsGoInItsOwnTick) {
  test::RigOptions options = coupled(10000);
  options.tissue.threshold_N = 25;
  options.pressed_N = 30;
  test::Rig rig(options);
  double last_N = 0;
  for (int i = 0; i < 1500; ++i) {
    const TickResult& result = rig.tick();
    if (result.contact.gave_way) {
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
