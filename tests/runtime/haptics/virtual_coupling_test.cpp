// SPDX-License-Identifier: Apache-2.0
// The virtual coupling: in the loop, compared with springs in series.
#include "runtime/haptics/virtual_coupling.h"

#include <gtest/gtest.h>

#include <algorithm>

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
      LocalEnvironment sheet;
      const double depth_m = -move_proxy(options, 1e-3, tool, state).p_m.z();
      sheet.sheet_N = kSheet_N_per_m * depth_m;
      sheet.sheet_N_per_m = kSheet_N_per_m;
      sheet.sheet_N_s_per_m = damping;
      // Without a rate in a contact's first tick.
      const double rate_m_per_s = i > 1 ? (depth_m - last_depth_m) / 1e-3 : 0;
      const double force_N = std::max(0.0, sheet.sheet_N + damping * rate_m_per_s);
      last_depth_m = depth_m;
      const double felt_N =
          coupling_wrench(options, force_N * Wrench::Unit(2), sheet, false, state)[2];
      if (i == 1) continue;  // the coupling acts from the next tick on
      ASSERT_NEAR(felt_N, force_N, 1e-6 * felt_N) << damping << ", " << i;
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
// threshold, not before. A spring alone never pulls, and releases the coupling in the same tick.
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
      if (damping == 0 && punctured) {
        EXPECT_EQ(result.row.wrench_wanted[2], 0);
        EXPECT_EQ(MotorVector(result.row.tau_Nm.data()).norm(), 0);
      }
      if (punctured) break;
      last_N = result.row.wrench_wanted[2];
      EXPECT_TRUE(damping > 0 || last_N >= 0) << "never pulls";
    }
    ASSERT_TRUE(punctured) << damping;
    EXPECT_NEAR(last_N, 25, 1) << damping;
    EXPECT_LT(rig.result_.contact.trial_force_N, 26) << damping;
  }
}

TEST(VirtualCoupling, TheRecordedTipIsThatOfTheProxy) {
  test::RigOptions options = coupled(5000);
  options.tissue.threshold_N = 25;
  options.pressed_N = 30;
  test::Rig rig(options);
  double apart_m = 0, apart_max_m = 0;
  int ticks_after = 0;
  for (int i = 0; i < 1500 && ticks_after < 3; ++i) {
    const TickResult& result = rig.tick();
    if (result.row.safety != SafetyState::kRunning) continue;
    const Eigen::Vector3d tip_m(result.row.tool_m.data());
    ASSERT_NEAR((tip_m - result.contact.tip_device_m).norm(), 0, 1e-12) << i;
    apart_m = (tip_m - rig.state_.T_device_plate * rig.model_.tool.tip_plate_m).norm();
    apart_max_m = std::max(apart_max_m, apart_m);
    if (ticks_after > 0 || result.contact.punctured_now) ++ticks_after;
  }
  ASSERT_EQ(ticks_after, 3) << "the sheet was punctured";
  EXPECT_NEAR(apart_max_m, 25.0 / 5000, 5e-4) << "the coupling under the threshold's force";
  EXPECT_NEAR(apart_m, 0, 1e-9) << "after the puncture";
}

// A tilted shaft is moved in and out of several holes and aside: the coupling renders what acts on
// the proxy, which is friction that slides, its dampers, and the rims in series with the coupling.
TEST(VirtualCoupling, ShaftAndRimAreRenderedAsTheyAre) {
  for (const double tilt_rad : {0.0, 0.5}) {
    for (const double viscous : {0.0, 10.0, 300.0}) {
      ShaftTissue tissue{2, viscous, 2e-4, 1500};
      CouplingOptions options;
      CouplingState state;
      constexpr int kHoles = 3;
      ShaftState holes[kHoles];
      const Eigen::Vector3d axis(std::sin(tilt_rad), 0, std::cos(tilt_rad));
      const auto place_at = [&](const Eigen::Vector3d& tip_m, double z_m) {
        const double inserted_m = (z_m - tip_m.z()) / axis.z();
        return ShaftSection{tip_m + inserted_m * axis, axis, inserted_m};
      };
      for (int i = 0; i < kHoles; ++i)
        enter_hole(place_at({0, 0, 0}, 0.002 * (i + 1)), holes[i]);
      double felt_max_N = 0;
      Eigen::Vector3d last_N = Eigen::Vector3d::Zero();
      for (int i = 0; i < 4000; ++i) {
        const double s = 2 * 3.14159265358979 * i / 1000;
        Pose tool;  // 3 mm along the axis, 2 mm aside
        tool.p_m = 3e-3 * std::sin(s) * axis + Eigen::Vector3d(0, 2e-3 * std::sin(0.5 * s), 0);
        const Eigen::Vector3d tip_m = move_proxy(options, 1e-3, tool, state).p_m;
        LocalEnvironment local;
        Eigen::Vector3d acts_N = Eigen::Vector3d::Zero();
        for (int k = 0; k < kHoles; ++k) {
          const ShaftSection place = place_at(tip_m, 0.002 * (k + 1));
          acts_N += shaft_force(tissue, place, 1e-3, holes[k]);
          add_shaft(tissue, place, holes[k], local);
        }
        Wrench acts = Wrench::Zero();
        acts.head<3>() = acts_N;
        const Eigen::Vector3d felt_N =
            coupling_wrench(options, acts, local, false, state).head<3>();
        if (i > 2) {
          ASSERT_NEAR((felt_N - acts_N).norm(), 0, 1e-9)
              << tilt_rad << ", " << viscous << ", " << i;
          ASSERT_LT((felt_N - last_N).norm(), 6 + 0.01 * viscous) << "no chatter";
        }
        last_N = felt_N;
        felt_max_N = std::max(felt_max_N, felt_N.norm());
      }
      EXPECT_GT(felt_max_N, 3 * tissue.dry_friction_N);
    }
  }
}

// The hand presses through one sheet, with friction in its hole, and moves on: punctured once, and
// the force changes by the friction's spring at most. Without the shaft in the proxy's equilibrium
// the proxy jumps out of its hole, and the sheet is punctured again.
TEST(VirtualCoupling, ASheetWithFrictionIsPuncturedOnce) {
  for (const double stiffness : {3000.0, 10000.0, 30000.0}) {
    test::RigOptions options = coupled(stiffness);
    options.tissue.threshold_N = 20;
    options.tissue.shaft = {3, 10, 2e-4, 1000};
    options.pressed_N = 45;
    options.hand_stiffness_N_per_m = 4000;
    options.hand_damping_N_s_per_m = 100;
    options.lifted_at_s = 0.7;
    test::Rig rig(options);
    int punctures = 0;
    double last_N = 0;
    for (int i = 0; i < 1100; ++i) {
      const TickResult& result = rig.tick();
      punctures += result.contact.punctured_now ? 1 : 0;
      const double force_N = result.row.wrench_wanted[2];
      if (punctures > 0 && !result.contact.punctured_now) {
        ASSERT_LT(std::abs(force_N - last_N), 5) << stiffness << ", tick " << i;
      }
      last_N = force_N;
    }
    EXPECT_EQ(punctures, 1) << stiffness;
    EXPECT_EQ(rig.state_.safety.fault, Fault::kNone);
  }
}

}  // namespace
}  // namespace trocar::runtime
