// SPDX-License-Identifier: Apache-2.0
// The damper after a break, on random motions and on a point mass that coasts.
#include "runtime/haptics/loop/break_through.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "tests/support/uniform.h"

namespace trocar::runtime {
namespace {

using trocar::test::uniform;

constexpr double kMass_kg = 0.35;

Tool tool_with_offset() {
  Tool tool;
  tool.tip_plate_m = {0.01, -0.02, -0.1};
  return tool;
}

TEST(BreakDamper, WithoutABreakThereIsNoForce) {
  std::mt19937_64 random(1);
  BreakDamperState state;
  BreakInput input;
  input.pose_interval_s = 1e-3;
  for (int i = 0; i < 1000; ++i) {
    input.T_device_plate.p_m.z() -= 1e-3 * uniform(random);
    EXPECT_EQ(damp_break({}, kMass_kg, tool_with_offset(), input, state), Wrench::Zero());
  }
}

TEST(BreakDamper, OnlyTakesEnergyAndActsAtTheTipAlongTheShaft) {
  std::mt19937_64 random(2);
  const Tool tool = tool_with_offset();
  const auto around_zero = [&] { return uniform(random) - 0.5; };
  BreakDamperState state;
  BreakInput input;
  input.pose_interval_s = 1e-3;
  int pushed = 0;
  for (int i = 0; i < 20'000; ++i) {
    const Pose before = input.T_device_plate;
    Pose& plate = input.T_device_plate;
    plate.p_m += 1e-4 * Eigen::Vector3d(around_zero(), around_zero(), around_zero());
    plate.q =
        (from_rotation_vector(1e-3 * Eigen::Vector3d(around_zero(), around_zero(), around_zero())) *
         plate.q)
            .normalized();
    input.lost_force_N = i % 50 == 0 ? 60 * uniform(random) : 0;
    const Wrench wrench = damp_break({}, kMass_kg, tool, input, state);
    const Eigen::Vector3d tip_m = plate * tool.tip_plate_m, up = plate.q * tool.axis_plate,
                          force_N = wrench.head<3>(),
                          moment_Nm = (tip_m - plate.p_m).cross(force_N);
    ASSERT_NEAR(force_N.cross(up).norm(), 0, 1e-12);
    ASSERT_NEAR((Eigen::Vector3d(wrench.tail<3>()) - moment_Nm).norm(), 0, 1e-12);
    const double inward_m = up.dot(before * tool.tip_plate_m - tip_m);
    if (inward_m <= 0 || i == 0) {
      ASSERT_EQ(wrench, Wrench::Zero()) << i;
      continue;
    }
    ASSERT_GE(force_N.dot(up), 0);
    ASSERT_LE(force_N.dot(up), damping_max({}, kMass_kg, 1e-3) * inward_m / 1e-3 + 1e-9);
    pushed += force_N.dot(up) > 0;
  }
  EXPECT_GT(pushed, 5000);
}

TEST(BreakDamper, TheCoefficientFallsWithTheSquareOfTimeAndALaterBreakOnlyRaisesIt) {
  BreakDamperState state;
  BreakInput input;
  input.pose_interval_s = 1e-3;
  const auto coefficient_after = [&](double lost_N) {
    input.T_device_plate.p_m.z() -= 1e-4;
    input.lost_force_N = lost_N;
    return damp_break({}, kMass_kg, Tool(), input, state)[2] / 0.1;  // at 0.1 m/s
  };
  EXPECT_EQ(coefficient_after(0), 0);
  const double start_N_s_per_m = 30 / kBreakSpeed_m_per_s;
  EXPECT_NEAR(coefficient_after(30), start_N_s_per_m, 1e-9) << "from the tick of the break on";
  for (int k = 1; k < 50; ++k)
    ASSERT_NEAR(coefficient_after(0),
                start_N_s_per_m * (1 - std::pow(k * 1e-3 / kBreakDamping_s, 2)), 1e-9);
  // Three quarters of 30 N are left, so 20 N change nothing.
  EXPECT_NEAR(coefficient_after(20), start_N_s_per_m * 0.75, 1e-9);
  EXPECT_NEAR(coefficient_after(25), 25 / kBreakSpeed_m_per_s, 1e-9);
  for (int k = 0; k < 99; ++k)
    EXPECT_GT(coefficient_after(0), 0);
  EXPECT_NEAR(coefficient_after(0), 0, 1e-9);
}

TEST(BreakDamper, WithoutANewPoseTheForceIsHeld) {
  BreakDamperState state;
  BreakInput input{.pose_interval_s = 1e-3};
  damp_break({}, kMass_kg, Tool(), input, state);
  input.lost_force_N = 30;
  input.T_device_plate.p_m.z() = -1e-4;
  const Wrench wrench = damp_break({}, kMass_kg, Tool(), input, state);
  EXPECT_GT(wrench[2], 1);
  input.lost_force_N = 0;
  input.pose_interval_s = 0;
  for (int i = 0; i < 5; ++i)
    EXPECT_EQ(damp_break({}, kMass_kg, Tool(), input, state), wrench);
}

// Time stamps that are off by 0.49 ms make intervals of 0.02 to 1.98 ms out of ticks of 1 ms.
TEST(BreakDamper, WhateverTheIntervalsTheForceIsAtMostTheLostForceAndStepsByAFifthOfIt) {
  std::mt19937_64 random(3);
  for (const double speed_m_per_s : {0.05, 0.3, 1.0, 4.0}) {
    for (const double off_s : {0.49e-3, 0.475e-3, 0.3e-3, 0.0}) {
      BreakDamperState state;
      BreakInput input;
      double before_s = 0, before_N = 0, max_N = 0;
      constexpr double kLost_N = 10;
      for (int k = 1; k <= 300; ++k) {
        const double t_s = 1e-3 * k + off_s * (2 * uniform(random) - 1);
        input.pose_interval_s = k % 17 == 0 ? 0 : t_s - before_s;
        if (k % 17 != 0) {
          before_s = t_s;
          // Now and then the tip turns back, or a reading is off by 0.1 mm.
          const double noise_m = k % 23 == 0 ? 1e-4 * (2 * uniform(random) - 1) : 0;
          const double way_m = 1e-3 * speed_m_per_s * k;
          input.T_device_plate.p_m.z() = (k / 30 == 2 ? way_m : -way_m) + noise_m;
        }
        input.lost_force_N = k == 20 ? kLost_N : 0;
        const double now_N = damp_break({}, kMass_kg, Tool(), input, state)[2];
        ASSERT_GE(now_N, 0);
        ASSERT_LE(now_N, kLost_N) << speed_m_per_s << " m/s, off by " << off_s << " s, tick " << k;
        ASSERT_LE(std::abs(now_N - before_N), kLost_N / 5 + 1e-9)
            << speed_m_per_s << " m/s, off by " << off_s << " s, tick " << k;
        before_N = now_N;
        max_N = std::max(max_N, now_N);
      }
      EXPECT_GT(max_N, 0.5 * kLost_N * std::min(1.0, speed_m_per_s / kBreakSpeed_m_per_s));
      EXPECT_EQ(before_N, 0) << "after its time it is zero";
    }
  }
}

// A difference of 0.05 ms, on its own, gave 40 N.
TEST(BreakDamper, ASingleShortIntervalDoesNotRaiseTheForceAboveTheLostOne) {
  for (const double interval_s : {5e-5, 1e-6, 1e-9}) {
    BreakDamperState state;
    BreakInput input{.pose_interval_s = 1e-3};
    damp_break({}, kMass_kg, Tool(), input, state);
    input.lost_force_N = 10;
    input.pose_interval_s = interval_s;
    input.T_device_plate.p_m.z() = -3e-4;
    EXPECT_LE(damp_break({}, kMass_kg, Tool(), input, state)[2], 2 + 1e-12) << interval_s;
    input.lost_force_N = 0;
    for (int i = 0; i < 20; ++i) {
      input.pose_interval_s = 0;
      ASSERT_LE(damp_break({}, kMass_kg, Tool(), input, state)[2], 10) << interval_s;
    }
  }
}

// A plate that coasts freely goes as far as the exact solution of m dv/dt = -b(t) v says, up to the
// way of a tick and a half (the delay of sampling), and never turns back.
TEST(BreakDamper, StopsAPlateThatCoastsWithoutTurningItBack) {
  constexpr double kLost_N = 30, kSpeed_m_per_s = 0.2;
  constexpr double kRate_per_s = kLost_N / kBreakSpeed_m_per_s / kMass_kg;
  double exact_m = 0;
  constexpr int kSteps = 10'000;
  for (int i = 0; i < kSteps; ++i) {
    const double t_s = (i + 0.5) / kSteps * kBreakDamping_s;
    exact_m += kBreakDamping_s / kSteps * kSpeed_m_per_s *
               std::exp(-kRate_per_s * (t_s - std::pow(t_s, 3) / 3 / std::pow(kBreakDamping_s, 2)));
  }
  for (const double rate_Hz : {250.0, 500.0, 1000.0, 8000.0}) {
    BreakDamperState state;
    BreakInput input{.pose_interval_s = 1 / rate_Hz};
    double z_m = kSpeed_m_per_s / rate_Hz, v_m_per_s = -kSpeed_m_per_s;
    input.T_device_plate.p_m.z() = z_m;
    damp_break({}, kMass_kg, Tool(), input, state);
    input.lost_force_N = kLost_N;
    z_m = 0;
    for (int i = 0; i < std::lround(kBreakDamping_s * rate_Hz); ++i) {
      input.T_device_plate.p_m.z() = z_m;
      const double a = damp_break({}, kMass_kg, Tool(), input, state)[2] / kMass_kg;
      input.lost_force_N = 0;
      z_m += v_m_per_s / rate_Hz + 0.5 * a / (rate_Hz * rate_Hz);
      v_m_per_s += a / rate_Hz;
      ASSERT_LE(v_m_per_s, 1e-12) << rate_Hz;
    }
    EXPECT_NEAR(-z_m, exact_m, 0.01 * exact_m + 1.5 / rate_Hz * kSpeed_m_per_s) << rate_Hz;
    EXPECT_GT(v_m_per_s, -0.05 * kSpeed_m_per_s) << rate_Hz;
  }
}

}  // namespace
}  // namespace trocar::runtime
