// SPDX-License-Identifier: Apache-2.0
// The window of velocities, the passivity controller and the limit on the energy released to the hand:
// against their definitions, on a point mass, and in the loop.
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

// The window over which velocities are taken, on encoders of known motion and resolution.

constexpr double kPeriod_s = 1e-3;
constexpr double kCount_rad = 2 * std::numbers::pi / 20'000;

/// A plate at a height of 0.1 m per radian of each encoder.
struct Motion {
  explicit Motion(std::function<double(double)> angle, double count = 0)
      : angle_rad(std::move(angle)), count_rad(count) {}
  std::function<double(double)> angle_rad;
  double count_rad;
  VelocityWindow window;
  Pose last, newest;
  double last_t_s = 0, newest_t_s = 0;

  void at(double t_s) {
    Measurement state{t_s, kMaxMeasured, {}};
    for (std::size_t i = 0; i < kMaxMeasured; ++i) {
      // Each encoder has another zero, so that counts come at different times.
      const double exact = angle_rad(t_s) + 0.1 * static_cast<double>(i) * kCount_rad;
      state.value[i] = count_rad > 0 ? std::round(exact / count_rad) * count_rad : exact;
    }
    last = newest;
    last_t_s = newest_t_s;
    newest.p_m.z() = 0.1 * state.value[0];
    newest_t_s = t_s;
    window.add(state, newest);
  }
  double velocity() const {
    const PreviousPose begin = window.begin(count_rad, kPeriod_s);
    const Pose& from = begin.ago_s > 0 ? begin.T_device_plate : last;
    const double over_s = begin.ago_s > 0 ? begin.ago_s : newest_t_s - last_t_s;
    return (newest.p_m.z() - from.p_m.z()) / over_s;
  }
};

TEST(VelocityWindow, ASteadyMotionHasTheErrorOfACountOverTheWholeWindow) {
  for (const double speed : {0.0, 0.01, 0.3, 1.0, -2.0}) {
    Motion motion([&](double t_s) { return speed * t_s; }, kCount_rad);
    std::mt19937_64 random(7);
    double t_s = 0, largest = 0, ago_s = 0;
    for (int i = 0; i < 500; ++i) {
      t_s += kPeriod_s * (0.25 + static_cast<double>(random() % 8) / 4);
      motion.at(t_s);
      if (i <= kVelocitySamples) continue;
      largest = std::max(largest, std::abs(motion.velocity() - 0.1 * speed));
      ago_s = motion.window.begin(kCount_rad, kPeriod_s).ago_s;
      ASSERT_LE(std::abs(motion.velocity() - 0.1 * speed), 0.1 * kCount_rad / ago_s * (1 + 1e-6));
    }
    EXPECT_GT(ago_s, 0.7 * kVelocitySamples * 1.125 * kPeriod_s) << "the whole window";
    EXPECT_LT(largest, 0.1 * kCount_rad / (0.5 * kVelocitySamples * kPeriod_s));
  }
}

// A difference over one period has an error of up to a count in it: 31 mm/s here.
TEST(VelocityWindow, AnAcceleratingMotionLagsByWhatTheEncodersCannotTell) {
  for (const double acceleration : {5.0, 20.0, 80.0}) {  // rad/s^2; 0.5 to 8 m/s^2
    Motion motion([&](double t_s) { return acceleration * t_s * t_s / 2; }, kCount_rad);
    double largest = 0;
    for (int i = 0; i < 300; ++i) {
      motion.at(i * kPeriod_s);
      if (i < 50) continue;
      largest = std::max(largest, std::abs(motion.velocity() - 0.1 * acceleration * i * kPeriod_s));
    }
    // A line leaves a parabola by a T^2 / 8: with a band of one count, and half a count of each
    // reading, that is at most two counts. The lag is a T / 2, and the ends' error a count over T.
    const double window_s = std::sqrt(16 * kCount_rad / acceleration) + kPeriod_s;
    EXPECT_LE(largest, 0.1 * (acceleration * window_s / 2 + 2 * kCount_rad / window_s))
        << acceleration;
    EXPECT_LT(largest, 0.1 * kCount_rad / kPeriod_s) << "less than without a window";
  }
}

TEST(VelocityWindow, ATurnEndsTheWindow) {
  Motion motion([](double t_s) { return -std::abs(t_s - 0.1); }, kCount_rad);
  for (int i = 0; i <= 110; ++i)
    motion.at(i * kPeriod_s);
  EXPECT_NEAR(motion.velocity(), -0.1, 0.005) << "10 ms after a turn, as before it";
  EXPECT_LE(motion.window.begin(kCount_rad, kPeriod_s).ago_s, 10.5 * kPeriod_s);
}

TEST(VelocityWindow, ALateStateHasTheVelocityOfOneOnTime) {
  // At constant acceleration the result is the velocity half a period earlier, whatever the intervals.
  Motion motion([](double t_s) { return 40 * t_s * t_s; });
  std::mt19937_64 random(3);
  double t_s = 0;
  for (int i = 0; i < 200; ++i) {
    const double interval_s = kPeriod_s * (1.25 + static_cast<double>(random() % 20) / 4);
    t_s += interval_s;
    motion.at(t_s);
    if (i < 3) continue;
    EXPECT_NEAR(motion.velocity(), 8 * (t_s - kPeriod_s / 2), 1e-9) << i;
  }
}

// Before a late state, an interval of a fifth of a tick: the time stamps are off, and an
// extrapolation over it would turn the velocity round.
TEST(VelocityWindow, AShortIntervalIsNotExtrapolated) {
  for (const double before_s : {0.2e-3, 0.3e-3, 0.49e-3}) {
    Motion motion([](double t_s) { return t_s; });
    for (int i = 0; i < 5; ++i)
      motion.at(i * kPeriod_s);
    // The true motion is one period from state to state.
    Pose pose = motion.newest;
    for (const double stamp_s : {4e-3 + before_s, 6e-3}) {
      pose.p_m.z() += 1e-4;
      motion.window.add({stamp_s, 0, {}}, pose);
    }
    EXPECT_EQ(motion.window.begin(0, kPeriod_s).ago_s, 0) << before_s;
  }
}

TEST(VelocityWindow, ClearedItHasNoMotion) {
  Motion motion([](double t_s) { return t_s; }, kCount_rad);
  for (int i = 0; i < 20; ++i)
    motion.at(i * kPeriod_s);
  ASSERT_GT(motion.window.begin(kCount_rad, kPeriod_s).ago_s, 0);
  motion.window.clear();
  EXPECT_EQ(motion.window.begin(kCount_rad, kPeriod_s).ago_s, 0);
  motion.at(1);
  motion.at(1 + 5 * kPeriod_s);
  EXPECT_EQ(motion.window.begin(kCount_rad, kPeriod_s).ago_s, 0);
}

// The passivity controller, on a point mass that moves exactly under held forces, and in the loop:
// a hand without damping pressed against walls that would oscillate without the controller.

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

test::RigOptions undamped_wall(bool passivity) {
  test::RigOptions options;
  options.tissue.stiffness_N_per_m = 30000;
  options.rate_Hz = 1000;
  options.passivity = passivity;
  return options;
}

// A stiff wall, pressed by a hand without damping: without the controller it is driven by the
// sampling, and the limit acts all the same. Torques are zero in the tick that finds it.
TEST(EnergyInTheLoop, AWallThatDrivesTheHandIsAFaultAlsoWithoutTheController) {
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
