// SPDX-License-Identifier: Apache-2.0 The passivity observer and the limit on the energy released
// to the hand: against their definitions, and, with the estimator, in the loop.
#include "runtime/haptics/loop/passivity.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <numbers>
#include <random>
#include <utility>
#include <vector>

#include "tests/support/loop_rig.h"
#include "tests/support/uniform.h"

namespace trocar::runtime {
namespace {

using trocar::test::uniform;

// Random wrenches and motions: the balance by its definition.
TEST(Passivity, TheBalanceIsTheAbsorbedWorkLessTheStoredEnergy) {
  std::mt19937_64 random(4);
  PassivityState state;
  PassivityInput input;
  input.wrench_device << 1, 2, 3, 0.1, 0.2, 0.3;
  observe_passivity(input, state);
  double work_J = 0;
  Wrench held = input.wrench_device;
  for (int i = 0; i < 3000; ++i) {
    state.delivered = held;
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
    observe_passivity(input, state);
    held = input.wrench_device;
    ASSERT_NEAR(state.balance_J, -work_J - input.stored_J, 1e-11);
    ASSERT_GE(state.released_max_J, -state.balance_J - input.stored_J);
  }
}

TEST(Passivity, AReleaseAndTheEndOfAContactEndTheBalance) {
  for (const bool is_planned : {false, true}) {
    PassivityState state;
    PassivityInput input;
    input.wrench_device[2] = 10;
    input.stored_J = 0.01;
    observe_passivity(input, state);
    state.delivered = input.wrench_device;
    input.T_device_plate.p_m.z() = 1e-3;
    observe_passivity(input, state);
    EXPECT_NEAR(state.balance_J, -0.02, 1e-12) << "given 10 mJ, and holding 10";
    input.planned_release = is_planned;
    if (!is_planned) input.wrench_device.setZero();
    input.stored_J = 0;
    observe_passivity(input, state);
    EXPECT_EQ(state.balance_J, 0);
  }
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

  options.is_led = false;
  test::Rig without(options);
  without.run_until(1.5);
  EXPECT_GT(without.run_until(2), 1e-3) << "without the lead it oscillates";
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

// The limit on the energy released to the hand: against its definition, and in the loop.

/// A point that is moved along z; `along_N` is delivered on the way.
struct Moved {
  EnergyAccount account;
  SafetyLimits limits;
  double rate_Hz = 1000;
  Pose pose;
  Fault move(double along_N, double step_m, double stored_J, bool is_released = false) {
    account.note_delivered(along_N * Wrench::Unit(2));
    pose.p_m.z() += step_m;
    return account.check(limits, rate_Hz, {pose, true, stored_J, is_released});
  }
};

TEST(EnergyLimit, AnEnergyThatIsNotFiniteIsBeyondIt) {
  for (const double stored_J : {std::nan(""), HUGE_VAL}) {
    Moved moved;
    EXPECT_EQ(moved.move(0, 1e-3, 0), Fault::kNone);
    EXPECT_EQ(moved.move(0, 1e-3, stored_J), Fault::kEnergyLimit);
  }
}

// W(t) - W(s) <= S(s) + limit for all s of the window, written out; with rotations, ticks without
// motion and punctures.
TEST(EnergyLimit, IsItsDefinition) {
  std::mt19937_64 random(3);
  int raised = 0, kept = 0;
  for (const double rate_Hz : {100.0, 333.0, 1000.0, 7999.0, 8000.0}) {
    EnergyAccount account;
    SafetyLimits limits;
    limits.energy_limit_J = 0.02;
    const auto window = static_cast<std::size_t>(std::floor(0.1 * rate_Hz + 1e-9));
    std::vector<double> work_J, stored_J;
    std::vector<bool> is_released;
    Pose pose;
    Wrench held = Wrench::Zero();
    double total_J = 0;
    for (std::size_t i = 0; i < 3 * window + 50; ++i) {
      Pose next = pose;
      if (random() % 5 != 0) {
        for (int k = 0; k < 3; ++k)
          next.p_m[k] += 1e-3 * (uniform(random) - 0.5);
        const Eigen::Vector3d turn = 1e-3 * Eigen::Vector3d(uniform(random), 0, -uniform(random));
        next.q = (from_rotation_vector(turn) * pose.q).normalized();
        total_J += held.head<3>().dot(next.p_m - pose.p_m) + held.tail<3>().dot(turn);
      }
      pose = next;
      work_J.push_back(total_J);
      stored_J.push_back(0.02 * uniform(random));
      is_released.push_back(random() % 9 == 0);
      double expected_J = 0;
      for (std::size_t s = i < window ? 0 : i - window; s <= i; ++s) {
        if (!is_released[s]) expected_J = std::max(expected_J, total_J - work_J[s] - stored_J[s]);
      }
      const Fault fault = account.check(limits, rate_Hz, {pose, true, stored_J[i], is_released[i]});
      ASSERT_NEAR(account.excess_J(), expected_J, 1e-12) << rate_Hz << ", " << i;
      ASSERT_EQ(fault, account.excess_J() <= 0.02 ? Fault::kNone : Fault::kEnergyLimit);
      ++(fault == Fault::kNone ? kept : raised);
      for (int k = 0; k < 6; ++k)
        held[k] = (k < 3 ? 20 : 2) * (uniform(random) - 0.4);
      account.note_delivered(held);
    }
    account.reset();
    EXPECT_EQ(account.check(limits, rate_Hz, {Pose{}, true, 0}), Fault::kNone);
    EXPECT_EQ(account.excess_J(), 0) << "the account starts again";
  }
  EXPECT_GT(raised, 100);
  EXPECT_GT(kept, 100);
}

// Item 1: springs of random stiffness, rendered at a share, with the exact work of every step;
// losses, punctures and forces that are held without a new pose in between.
TEST(EnergyLimit, AnEnvironmentThatGivesBackAtMostWhatItStoredNeverRaisesIt) {
  std::mt19937_64 random(5);
  for (int run = 0; run < 200; ++run) {
    Moved moved;
    moved.rate_Hz = std::exp(std::log(100.0) + uniform(random) * std::log(80.0));
    moved.limits.energy_limit_J = 1e-9;  // rounding
    const double share = run % 3 == 0 ? 1 : uniform(random);
    const double k = 1e5 * uniform(random);
    double depth_m = 0;
    for (int i = 0; i < 1000; ++i) {
      const double next_m = std::max(0.0, depth_m + 4e-3 * (uniform(random) - 0.5));
      const bool is_released = random() % 50 == 0;
      const double mean_N = share * k * (depth_m + next_m) / 2;
      const double lost_N = 5 * uniform(random) * (next_m > depth_m ? 1 : -1);
      const Fault fault = moved.move(mean_N + lost_N, depth_m - next_m,
                                     is_released ? 0 : 0.5 * k * next_m * next_m, is_released);
      ASSERT_EQ(fault, Fault::kNone) << run << ", " << i << ": " << moved.account.excess_J();
      depth_m = is_released ? 0 : next_m;
    }
  }
}

// Item 2: what a punctured sheet had stored may pass to the one below, and no more.
TEST(EnergyLimit, ASheetBelowMayTakeOverEnergyOfThePuncturedOne) {
  for (const double below_J : {0.09, 0.19}) {
    Moved moved;
    ASSERT_EQ(moved.move(0, 0, 0), Fault::kNone);
    ASSERT_EQ(moved.move(10, -0.012, 0.12), Fault::kNone);
    ASSERT_EQ(moved.move(0, 0, 0, true), Fault::kNone);
    ASSERT_EQ(moved.move(0, 0, below_J), Fault::kNone);
    EXPECT_EQ(moved.move(10, below_J / 10, 0),
              below_J < 0.12 + 0.05 ? Fault::kNone : Fault::kEnergyLimit);
    EXPECT_NEAR(moved.account.excess_J(), std::max(0.0, below_J - 0.12), 1e-12);
  }
}

// Item 3: while no pose comes the wrench changes and the plate moves on, at a constant speed.
TEST(EnergyLimit, WithoutNewPosesTheWorkIsCountedWithTheNextOne) {
  EnergyAccount account;
  SafetyLimits limits;
  limits.energy_limit_J = 1;
  Pose pose;
  ASSERT_EQ(account.check(limits, 1000, {pose}), Fault::kNone);
  double work_J = 0;
  for (int i = 0; i < 9; ++i) {
    account.note_delivered((1 + i) * Wrench::Unit(2));
    pose.p_m.z() += 1e-3;
    work_J += (1 + i) * 1e-3;
    account.check(limits, 1000, {pose, i == 8});
    EXPECT_NEAR(account.excess_J(), i == 8 ? work_J : 0, 1e-15) << i;
  }
  account.note_delivered(2 * Wrench::Unit(2));
  pose.p_m.z() += 1e-3;
  account.check(limits, 1000, {pose});
  EXPECT_NEAR(account.excess_J(), work_J + 2e-3, 1e-15);
}

TEST(EnergyLimit, ALimitOfNanOrANegativeLimitAlwaysTrips) {
  for (const double bad : {static_cast<double>(NAN), -0.1, -static_cast<double>(INFINITY)}) {
    Moved moved;
    moved.limits.energy_limit_J = bad;
    EXPECT_EQ(moved.move(0, 0, 0), Fault::kEnergyLimit) << bad;
    EXPECT_EQ(moved.move(0, 0, 1), Fault::kEnergyLimit) << bad;
  }
  Moved moved;
  moved.limits.energy_limit_J = 0;
  EXPECT_EQ(moved.move(0, 0, 0), Fault::kNone);
  EXPECT_EQ(moved.move(1, 1e-6, 0), Fault::kEnergyLimit);
  moved.limits.energy_limit_J = INFINITY;
  EXPECT_EQ(moved.move(1, 1e6, 0), Fault::kNone);
}

// --- in the loop ----------------------------------------------------------------------------

test::RigOptions undamped_wall(bool is_led) {
  test::RigOptions options;
  options.tissue.stiffness_N_per_m = 30000;
  options.rate_Hz = 1000;
  options.is_led = is_led;
  return options;
}

// A stiff wall, pressed by a hand without damping: without the lead it is driven by the sampling,
// and the limit acts. Torques are zero in the tick that finds it.
TEST(EnergyInTheLoop, AWallThatDrivesTheHandIsAFault) {
  test::Rig rig(undamped_wall(false));
  rig.model_.limits.energy_limit_J = 0.05;
  double given_J = 0, before_J = 0;
  Pose last;
  Wrench held = Wrench::Zero();
  for (int i = 0; i < 1000; ++i) {
    const TickResult& result = rig.tick();
    if (i > 0) given_J += held.dot(displacement(last, rig.state_.T_device_plate));
    last = rig.state_.T_device_plate;
    held = Wrench(result.row.wrench_delivered.data());
    if (result.new_fault != Fault::kNone) {
      EXPECT_EQ(result.new_fault, Fault::kEnergyLimit);
      EXPECT_TRUE(result.torques_are_zero);
      EXPECT_EQ(MotorVector(result.row.tau_Nm.data()).norm(), 0);
      EXPECT_GT(given_J, before_J);
      return;
    }
    before_J = given_J;
  }
  FAIL() << "no fault";
}

}  // namespace
}  // namespace trocar::runtime
