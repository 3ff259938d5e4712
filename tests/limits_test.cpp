// SPDX-License-Identifier: Apache-2.0
// The limits: inside they find nothing, outside they name their fault; what may be written is
// always within bounds.
#include "runtime/loop/limits.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace trocar::runtime {
namespace {

double unit(std::mt19937_64& random) {
  return static_cast<double>(random() >> 11) * 0x1p-53;
}

TEST(Limits, WorkspaceIsABoxAndATilt) {
  const SafetyLimits limits;
  std::mt19937_64 random(3);
  int inside = 0, outside = 0;
  for (int i = 0; i < 20000; ++i) {
    Pose pose;
    pose.p_m = {0.16 * unit(random) - 0.08, 0.16 * unit(random) - 0.08, 0.26 * unit(random)};
    const double tilt_rad = unit(random);
    const double azimuth_rad = 6 * unit(random);
    pose.q = from_rotation_vector(tilt_rad *
                                  Eigen::Vector3d(std::cos(azimuth_rad), std::sin(azimuth_rad), 0));
    const bool good = std::abs(pose.p_m.x()) <= 0.06 && std::abs(pose.p_m.y()) <= 0.06 &&
                      pose.p_m.z() >= 0.06 && pose.p_m.z() <= 0.24 && tilt_rad <= 0.6;
    ASSERT_EQ(check_workspace(limits, pose), good ? Fault::kNone : Fault::kWorkspace);
    ++(good ? inside : outside);
  }
  EXPECT_GT(inside, 1000);
  EXPECT_GT(outside, 1000);
  Pose broken;
  broken.p_m = {0, NAN, 0.1};
  EXPECT_EQ(check_workspace(limits, broken), Fault::kWorkspace);
  broken.p_m.y() = 0;
  broken.q.x() = NAN;
  EXPECT_EQ(check_workspace(limits, broken), Fault::kWorkspace);
}

TEST(Limits, SpeedIsSeenAtEveryRateAndACountIsNone) {
  const SafetyLimits limits;
  for (const double rate_Hz : {500.0, 1000.0, 8000.0}) {
    for (const double turns : {0.0, 1.0}) {
      const double most = turns > 0 ? limits.turn_rate_max_rad_per_s : limits.speed_max_m_per_s;
      const auto at = [&](double way) {
        Pose pose;
        if (turns > 0) {
          pose.q = from_rotation_vector({0, way, 0});
        } else {
          pose.p_m.x() = way;
        }
        return pose;
      };
      for (const double share : {0.98, 1.1}) {
        LimitState state;
        double seen_s = -1;
        for (int k = 0; k * 1.0 < 0.05 * rate_Hz; ++k) {
          const double t_s = k / rate_Hz;
          if (check_speed(limits, at(share * most * t_s), 1 / rate_Hz, state) != Fault::kNone) {
            seen_s = t_s;
            break;
          }
        }
        if (share < 1) {
          EXPECT_EQ(seen_s, -1) << rate_Hz;
        } else {  // ln(11) time constants
          EXPECT_GT(seen_s, 0) << rate_Hz;
          EXPECT_LT(seen_s, 3.2 * limits.speed_window_s + 2 / rate_Hz) << rate_Hz;
        }
      }
    }
    // Forth and back by 0.1 mm every tick: 0.8 m/s at 8 kHz from tick to tick.
    LimitState state;
    for (int k = 0; k < 1000; ++k) {
      Pose pose;
      pose.p_m.x() = k % 2 == 0 ? 0 : 1e-4;
      ASSERT_EQ(check_speed(limits, pose, 1 / rate_Hz, state), Fault::kNone);
    }
  }
  LimitState state;
  Pose broken;
  check_speed(limits, broken, 1e-3, state);
  broken.p_m.x() = NAN;
  EXPECT_EQ(check_speed(limits, broken, 1e-3, state), Fault::kSpeed);
  check_speed(limits, Pose{}, 1e-3, state);
  EXPECT_EQ(check_speed(limits, Pose{}, 1e-3, state), Fault::kNone) << "and it is over with it";
}

TEST(Limits, HeatFollowsItsExactSolution) {
  SafetyLimits limits;
  limits.thermal_s = 2;
  DeviceDescription device = default_device_description();
  device.motor_peak_torque_Nm = 6;
  device.motor_continuous_torque_Nm = 3;
  for (const double rate_Hz : {500.0, 1000.0, 8000.0}) {
    for (int motor = 0; motor < kMotors; ++motor) {
      LimitState state;
      MotorVector tau = MotorVector::Zero();
      tau[motor] = motor % 2 == 0 ? 3 : -3;
      for (int k = 0; k < 100 * rate_Hz; ++k) {
        ASSERT_EQ(check_heat(limits, device, tau, 1 / rate_Hz, state), Fault::kNone);
      }
      EXPECT_NEAR(state.heat[motor], 1, 1e-9) << "the continuous torque, for ever";
      state = {};
      tau[motor] *= 2;
      int ticks = 0;
      while (check_heat(limits, device, tau, 1 / rate_Hz, state) == Fault::kNone)
        ASSERT_LT(++ticks, 20000);
      EXPECT_NEAR(ticks / rate_Hz, 2 * std::log(1 / (1 - 0.25)), 2 / rate_Hz);
    }
    if (rate_Hz > 1000) break;
  }
}

TEST(Limits, TorquesThatMayBeWrittenAreAlwaysWithinBounds) {
  std::mt19937_64 random(17);
  const DeviceDescription device = default_device_description();
  SafetyLimits limits;
  limits.torque_rise_time_max_s = 1e9;
  const double peak_Nm = device.motor_peak_torque_Nm;
  MotorVector last = MotorVector::Zero();
  LimitState state;
  int refused = 0, shortened = 0, unchanged = 0;
  for (int i = 0; i < 20000; ++i) {
    limits.torque_rise_max_Nm_per_s = i % 3 == 0 ? 1e9 : 800;
    MotorVector wanted;
    for (int k = 0; k < kMotors; ++k)
      wanted[k] = (unit(random) - 0.5) * (i % 7 == 0 ? 2.2 : 1.9) * peak_Nm;
    const MotorVector before = wanted;
    const bool too_much = wanted.cwiseAbs().maxCoeff() > peak_Nm * (1 + 1e-9);
    const Fault fault = limit_torques(limits, device, last, 1e-3, wanted, state);
    ASSERT_EQ(fault, too_much ? Fault::kTorqueLimit : Fault::kNone);
    if (fault != Fault::kNone) {
      ++refused;
      continue;
    }
    ASSERT_LE(wanted.cwiseAbs().maxCoeff(), peak_Nm);
    ++(wanted == before ? unchanged : shortened);
    last = wanted;
  }
  EXPECT_GT(refused, 100);
  EXPECT_GT(shortened, 100);
  EXPECT_GT(unchanged, 100);
  for (const double bad : {static_cast<double>(NAN), static_cast<double>(INFINITY)}) {
    MotorVector wanted = MotorVector::Zero();
    wanted[3] = bad;
    EXPECT_EQ(limit_torques(limits, device, last, 1e-3, wanted, state), Fault::kTorqueNotFinite);
  }
}

TEST(Limits, AWallThatRingsAgainstTheRateLimitIsAFaultAndAReleaseIsNoPause) {
  const DeviceDescription device = default_device_description();
  const SafetyLimits limits;
  LimitState state;
  MotorVector last = MotorVector::Zero();
  Fault fault = Fault::kNone;
  int tick = 0;
  for (; tick < 1000 && fault == Fault::kNone; ++tick) {  // full up, then nothing, in turn
    MotorVector wanted = MotorVector::Constant(tick % 2 == 0 ? 5.9 : 0);
    fault = limit_torques(limits, device, last, 1e-3, wanted, state);
    last = wanted;
  }
  EXPECT_EQ(fault, Fault::kTorqueRate);
  EXPECT_LE(tick, 50);
  EXPECT_GE(tick, 30);
}

}  // namespace
}  // namespace trocar::runtime
