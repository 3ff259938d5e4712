// SPDX-License-Identifier: Apache-2.0
// The passivity controller, on a point mass that moves exactly under held forces, and in the loop:
// a hand without damping pressed against walls that would oscillate without the controller.
#include "runtime/haptics/loop/passivity.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "tests/support/loop_rig.h"
#include "tests/support/uniform.h"

namespace trocar::runtime {
namespace {

using trocar::test::uniform;

/// A point mass against an elastic half space z < 0, a force of the hand added; the motion between
/// two ticks is the exact one under constant force.
struct MassOnWall {
  double mass_kg = 0.35, stiffness_N_per_m = 5000, hand_N = -20, dt_s = 1e-3;
  PassivityOptions options;
  PassivityState state;
  double z_m = 0, v_m_per_s = 0, work_J = 0;  ///< work of the rendered force on the mass
  double rendered_N = 0;
  bool punctured = false;

  void tick() {
    PassivityInput input;
    input.T_device_plate.p_m.z() = z_m;
    const double depth_m = punctured ? 0 : std::max(0.0, -z_m);
    input.wrench_device[2] = stiffness_N_per_m * depth_m;
    input.stored_J = 0.5 * stiffness_N_per_m * depth_m * depth_m;
    const Wrench wrench = keep_passive(options, mass_kg, dt_s, input, state);
    state.delivered = wrench;
    rendered_N = wrench[2];
    const double a = (rendered_N + hand_N) / mass_kg;
    const double step_m = v_m_per_s * dt_s + 0.5 * a * dt_s * dt_s;
    work_J += rendered_N * step_m;
    z_m += step_m;
    v_m_per_s += a * dt_s;
  }
};

TEST(Passivity, TheBalanceIsTheAbsorbedWorkLessTheStoredEnergy) {
  std::mt19937_64 random(1);
  for (const bool on : {false, true}) {
    PassivityOptions options;
    options.on = on;
    options.credit_max_J = 1e9;
    PassivityState state;
    PassivityInput input;
    input.wrench_device << 1, 2, 3, 0.1, 0.2, 0.3;
    keep_passive(options, 0.35, 1e-3, input, state);
    double work_J = 0;
    Wrench held = input.wrench_device;
    state.delivered = held;
    for (int i = 0; i < 3000; ++i) {
      Eigen::Vector3d turn, move;
      for (int k = 0; k < 3; ++k) {
        turn[k] = 1e-3 * (uniform(random) - 0.5);
        move[k] = 1e-4 * (uniform(random) - 0.5);
        input.wrench_device[k] = 10 * (uniform(random) - 0.5);
        input.wrench_device[3 + k] = uniform(random) - 0.5;
      }
      input.stored_J = 0.01 * uniform(random);
      input.T_device_plate.p_m += move;
      input.T_device_plate.q = (from_rotation_vector(turn) * input.T_device_plate.q).normalized();
      work_J += held.head<3>().dot(move) + held.tail<3>().dot(turn);
      held = keep_passive(options, 0.35, 1e-3, input, state);
      state.delivered = held;
      ASSERT_NEAR(state.balance_J, -work_J - input.stored_J, 1e-11);
    }
  }
}

TEST(Passivity, WithoutANewPoseTheForceIsHeldAndDampingUsesTheTimeBetweenPoses) {
  PassivityOptions options;
  PassivityInput input;
  const auto damping = [&](int ticks) {  // of a step over `ticks` ticks, along the force
    PassivityState state;
    input.T_device_plate = Pose{};
    input.wrench_device << 0, 0, 10, 0, 0, 0;
    input.stored_J = 0.01;
    state.delivered = keep_passive(options, 0.35, 1e-3, input, state);
    state.balance_J = -1;
    input.T_device_plate.p_m.z() = 1e-4 * ticks;
    const Wrench wrench = keep_passive(options, 0.35, ticks * 1e-3, input, state);
    state.delivered = wrench;
    const double at_that_speed_N = state.damping_N_s_per_m * 0.1;
    EXPECT_GT(at_that_speed_N, 0);
    EXPECT_NEAR(10 - wrench[2], at_that_speed_N, 1e-9) << ticks;
    const PassivityState before = state;
    EXPECT_EQ(keep_passive(options, 0.35, 0, input, state), wrench)
        << "no new pose: the force is held";
    EXPECT_EQ(state.damping_N_s_per_m, before.damping_N_s_per_m);
    EXPECT_EQ(state.balance_J, before.balance_J);
    return state.damping_N_s_per_m;
  };
  for (const int ticks : {1, 2, 10})
    EXPECT_LE(damping(ticks), damping_max(options, 0.35, ticks * 1e-3)) << ticks;
}

// The last step is one of noise; the damper has the velocity of the steady motion around it.
TEST(Passivity, DampingTakesItsVelocityFromTheEarlierPose) {
  for (const double step_m : {1e-5, 2e-4, -1e-5}) {
    PassivityState state;
    PassivityInput input;
    input.wrench_device << 0, 0, step_m > 0 ? 10 : -10, 0, 0, 0;
    input.stored_J = 0.01;
    state.delivered = keep_passive({}, 0.35, 1e-3, input, state);
    state.balance_J = -1;
    input.T_device_plate.p_m.z() += step_m;
    input.previous.T_device_plate.p_m.z() = input.T_device_plate.p_m.z() - 1e-3;
    input.previous.ago_s = 0.01;  // 0.1 m/s up
    const Wrench wrench = keep_passive({}, 0.35, 1e-3, input, state);
    if (step_m > 0) {
      EXPECT_GT(state.damping_N_s_per_m, 0);
      EXPECT_LE(state.damping_N_s_per_m, damping_max({}, 0.35, 0.01));
      EXPECT_NEAR(10 - wrench[2], state.damping_N_s_per_m * 0.1, 1e-9);
    } else {
      EXPECT_EQ(wrench, input.wrench_device) << "a damper would push along the last step";
    }
  }
}

TEST(Passivity, TheWrenchIsUnchangedWhileTheEnvironmentOnlyAbsorbs) {
  for (const double dt_s : {2e-3, 1e-3, 1.25e-4}) {
    MassOnWall wall;
    wall.dt_s = dt_s;
    wall.options.credit_max_J = 0;
    for (int i = 0; i < static_cast<int>(0.4 / dt_s); ++i) {  // moved down steadily
      wall.z_m = -0.015 * i * dt_s;
      wall.v_m_per_s = 0;
      wall.hand_N = 0;
      const double law_N = wall.stiffness_N_per_m * std::max(0.0, -wall.z_m);
      wall.tick();
      ASSERT_EQ(wall.rendered_N, law_N) << "to the last bit";
      ASSERT_LE(wall.state.balance_J, 0) << "although the balance is negative";
    }
    EXPECT_LT(wall.state.balance_J, 0);
  }
}

TEST(Passivity, TheWrenchIsUnchangedInAPassiveEnvironment) {
  // A dissipative wall: a spring, and a damper well above K T / 2; energy not reported is below
  // credit.
  PassivityOptions options;
  PassivityState state;
  const double k = 5000, b = 20, dt_s = 1e-3;
  double last_m = 0;
  for (int i = 0; i < 4000; ++i) {
    const double depth_m = 2e-3 + 1e-3 * std::sin(0.05 * i);
    PassivityInput input;
    input.T_device_plate.p_m.z() = -depth_m;
    input.wrench_device[2] = k * depth_m + (i == 0 ? 0 : b * (depth_m - last_m) / dt_s);
    input.stored_J = 0.5 * k * depth_m * depth_m;
    last_m = depth_m;
    const Wrench wanted = input.wrench_device;
    const Wrench got = keep_passive(options, 0.35, dt_s, input, state);
    state.delivered = got;
    if (i > 200) {  // the contact began abruptly, at 2 mm
      ASSERT_EQ(got, wanted) << i;
    }
  }
  EXPECT_LE(state.balance_J, options.credit_max_J);
}

TEST(Passivity, DampingIsBoundedAndOpposesTheMotion) {
  std::mt19937_64 random(5);
  int acted = 0, bounded = 0;
  for (int run = 0; run < 300; ++run) {
    const double dt_s = 1 / (500 + 7500 * uniform(random));
    MassOnWall wall;
    wall.dt_s = dt_s;
    wall.mass_kg = 0.1 + uniform(random);
    wall.stiffness_N_per_m = std::pow(10, 3 + 2 * uniform(random));
    const double most = damping_max(wall.options, wall.mass_kg, dt_s);
    ASSERT_LE(most, 100);
    ASSERT_LE(most * dt_s / wall.mass_kg, 0.25 + 1e-12);
    for (int i = 0; i < 500; ++i) {
      const double law_N = wall.stiffness_N_per_m * std::max(0.0, -wall.z_m);
      const double last_m = wall.state.T_device_plate.p_m.z(), now_m = wall.z_m;
      wall.tick();
      ASSERT_LE(wall.state.damping_N_s_per_m, most * (1 + 1e-12));
      const double added_N = wall.rendered_N - law_N;
      ASSERT_LE(added_N * (now_m - last_m), 0);
      if (added_N != 0) {
        ++acted;
        ASSERT_NEAR(added_N, -wall.state.damping_N_s_per_m * (now_m - last_m) / dt_s,
                    1e-9 * (1 + std::abs(law_N)));
      }
      if (wall.state.damping_N_s_per_m == most) ++bounded;
    }
  }
  EXPECT_GT(acted, 5000);
  EXPECT_GT(bounded, 100);
}

// A tool that leaves a sheet fast: damping by the deficit of the push would reverse the force.
TEST(Passivity, DampingNeverPullsAndTheDeficitRemains) {
  std::mt19937_64 random(8);
  int cancelled = 0;
  for (int run = 0; run < 300; ++run) {
    PassivityOptions options;
    options.credit_max_J = 1e9;
    PassivityState state;
    PassivityInput input;
    input.wrench_device.head<3>() =
        20 * Eigen::Vector3d(uniform(random) - 0.5, uniform(random) - 0.5, uniform(random));
    input.wrench_device[3] = 0.2 * (uniform(random) - 0.5);
    input.stored_J = 0.01;
    state.delivered = keep_passive(options, 0.35, 1e-3, input, state);
    for (int i = 0; i < 30; ++i) {
      state.balance_J = -0.1 * uniform(random);
      const double before_J = state.balance_J;
      const Eigen::Vector3d step_m =
          2e-3 *
          Eigen::Vector3d(uniform(random) - 0.5, uniform(random) - 0.5, uniform(random) - 0.2);
      const Wrench held = state.delivered;
      input.T_device_plate.p_m += step_m;
      const Wrench wrench = keep_passive(options, 0.35, 1e-3, input, state);
      state.delivered = wrench;
      const Eigen::Vector3d of_sheet_N = input.wrench_device.head<3>();
      const double along = Eigen::Vector3d(wrench.head<3>()).dot(of_sheet_N);
      ASSERT_GE(along, -1e-9) << "a pull";
      if (state.damping_N_s_per_m > 0 && along < 1e-9) ++cancelled;
      ASSERT_NEAR(state.balance_J, before_J - held.head<3>().dot(step_m), 1e-12)
          << "what was not settled remains";
      const double damped_N = state.damping_N_s_per_m;
      const Wrench again = keep_passive(options, 0.35, 0, input, state);
      ASSERT_GE(Eigen::Vector3d(again.head<3>()).dot(of_sheet_N), -1e-9) << "without a new pose";
      ASSERT_LE(state.damping_N_s_per_m, damped_N);
    }
  }
  EXPECT_GT(cancelled, 100);
}

TEST(Passivity, AMassThrownAtAWallDoesNotReturnFaster) {
  // Without the controller it does: K (step)^2 / 2 a tick.
  int faster_without = 0, runs = 0;
  for (const double dt_s : {2e-3, 1e-3, 5e-4, 1.25e-4}) {
    for (const double k : {2000.0, 5000.0, 10000.0}) {
      for (const double v : {0.05, 0.2, 0.5}) {
        double back[2] = {};
        MassOnWall wall;
        for (const bool on : {false, true}) {
          wall = MassOnWall{};
          wall.dt_s = dt_s;
          wall.stiffness_N_per_m = k;
          wall.hand_N = 0;
          wall.options.on = on;
          wall.z_m = 0.3 * v * dt_s;
          wall.v_m_per_s = -v;
          for (int i = 0; i < 20000 && !(wall.v_m_per_s > 0 && wall.z_m > 0); ++i)
            wall.tick();
          back[on ? 1 : 0] = wall.v_m_per_s;
          if (on) {
            // Damping beyond its bound is missing, and the work of the last tick.
            const double energy_J = 0.5 * wall.mass_kg * v * v;
            const double last_tick_J = k * std::pow(v * dt_s, 2);
            EXPECT_LE(wall.work_J, 0.02 * energy_J + last_tick_J) << dt_s << " " << k << " " << v;
          }
        }
        EXPECT_LE(back[1], back[0]);
        if (back[0] > 1.01 * v) ++faster_without;
        ++runs;
      }
    }
  }
  EXPECT_GT(faster_without, runs / 2);
}

TEST(Passivity, APlannedReleaseCausesNoDamping) {
  MassOnWall wall;
  wall.hand_N = -30;
  int i = 0;
  for (; - wall.z_m * wall.stiffness_N_per_m < 35 && i < 10000; ++i)
    wall.tick();
  ASSERT_LT(i, 10000);
  PassivityInput release;
  release.T_device_plate.p_m.z() = wall.z_m;
  release.planned_release = true;
  EXPECT_EQ(keep_passive(wall.options, wall.mass_kg, wall.dt_s, release, wall.state).norm(), 0);
  EXPECT_EQ(wall.state.balance_J, 0);
  EXPECT_EQ(wall.state.damping_N_s_per_m, 0);
  // Friction on the shaft remains: the earlier balance causes no damping of it.
  release.planned_release = false;
  release.wrench_device[2] = 2;
  release.T_device_plate.p_m.z() -= 1e-4;
  EXPECT_EQ(keep_passive(wall.options, wall.mass_kg, wall.dt_s, release, wall.state)[2], 2);
}

// Makes a tick in which a damper acts against a force of 10 N, because much energy was given before.
// Returns the delivered wrench.
Wrench start_damping(PassivityInput& input, PassivityState& state) {
  input.wrench_device << 0, 0, 10, 0, 0, 0;
  input.stored_J = 0.01;
  state.delivered = keep_passive({}, 0.35, 1e-3, input, state);
  state.balance_J = -1;
  input.T_device_plate.p_m.z() = 1e-4;
  Wrench delivered = keep_passive({}, 0.35, 1e-3, input, state);
  state.delivered = delivered;
  return delivered;
}

// A prefetched stiffness that rises can puncture a sheet in a tick without a new pose, while a
// damper of the tick before acts.
TEST(Passivity, APlannedReleaseWithoutANewPoseEndsTheDamping) {
  PassivityState state;
  PassivityInput input;
  start_damping(input, state);
  ASSERT_GT(state.damping_N_s_per_m, 0);
  input.wrench_device[2] = 2;  // friction on the shaft
  input.stored_J = 0;
  input.planned_release = true;
  EXPECT_EQ(keep_passive({}, 0.35, 0, input, state)[2], 2);
  EXPECT_EQ(state.damping_N_s_per_m, 0);
  EXPECT_EQ(state.balance_J, 0);
}

// The hand turns back while no pose is new: the held damper pushes along, and the balance counts
// it.
TEST(Passivity, TheWorkOfADamperThatIsHeldWithoutANewPoseIsInTheBalance) {
  PassivityState state;
  PassivityInput input;
  Wrench held = start_damping(input, state);
  ASSERT_LT(held[2], 10);
  const double before_J = state.balance_J;
  for (int tick = 0; tick < 5; ++tick) {
    held = keep_passive({}, 0.35, 0, input, state);
    state.delivered = held;
    EXPECT_EQ(state.balance_J, before_J);
  }
  input.T_device_plate.p_m.z() = -3e-4;
  keep_passive({}, 0.35, 6e-3, input, state);
  EXPECT_NEAR(state.balance_J, before_J + held[2] * 4e-4, 1e-12);
}

// --- in the loop ----------------------------------------------------------------------------

struct Wall {
  double rate_Hz, stiffness_N_per_m;
};
class Walls : public testing::TestWithParam<Wall> {};
INSTANTIATE_TEST_SUITE_P(Passivity, Walls,
                         testing::Values(Wall{500, 5000}, Wall{1000, 5000}, Wall{1000, 30000}),
                         [](const auto& wall) {
                           return std::to_string(int(wall.param.stiffness_N_per_m)) + "_at_" +
                                  std::to_string(int(wall.param.rate_Hz)) + "Hz";
                         });

TEST_P(Walls, AnUndampedLightHandComesToRest) {
  test::RigOptions options;
  options.rate_Hz = GetParam().rate_Hz;
  options.tissue.stiffness_N_per_m = GetParam().stiffness_N_per_m;
  test::Rig rig(options);
  rig.run_until(1.5);
  EXPECT_LT(rig.run_until(2), 0.1e-3) << "residual oscillation, peak to peak";
  EXPECT_EQ(rig.state_.safety.fault, Fault::kNone);
  EXPECT_NEAR(rig.result_.contact.force_N, 35, 0.35);
  EXPECT_LT(rig.largest_N_, 40);

  options.passivity = false;
  test::Rig without(options);
  without.run_until(1.5);
  EXPECT_GT(without.run_until(2), 1e-3) << "without the controller it oscillates";
}

TEST(PassivityInTheLoop, AReleaseGivesLessThanAMillijoule) {
  for (const double rate_Hz : {500.0, 1000.0}) {
    for (const double damping : {0.0, 100.0}) {
      // Release by a puncture: the motors do no work afterwards.
      test::RigOptions options;
      options.rate_Hz = rate_Hz;
      options.hand_damping_N_s_per_m = damping;
      options.tissue.threshold_N = 35;
      options.pressed_N = 40;
      test::Rig punctured(options);
      double at_release_J = NAN;
      for (int i = 0; i < 0.8 * rate_Hz; ++i) {
        if (punctured.tick().contact.punctured_now) {
          EXPECT_EQ(MotorVector(punctured.result_.row.tau_Nm.data()).norm(), 0)
              << "in the same tick";
          at_release_J = punctured.device_->truth().work.motors_J;
          EXPECT_LT(at_release_J, -0.1) << "what the hand has put into the sheet";
        }
      }
      EXPECT_LE(punctured.device_->truth().work.motors_J - at_release_J, 1e-3);

      // Release by lifting off: in total the motors have done no work on the hand.
      options.tissue.threshold_N = 1e6;
      options.pressed_N = 30;
      options.lifted_at_s = 1;
      test::Rig lifted(options);
      lifted.run_until(2);
      EXPECT_EQ(lifted.result_.contact.force_N, 0);
      EXPECT_LE(lifted.device_->truth().work.motors_J, 1e-3);
      EXPECT_LE(lifted.state_.passivity.released_max_J, 1e-3);
    }
  }
}

}  // namespace
}  // namespace trocar::runtime
