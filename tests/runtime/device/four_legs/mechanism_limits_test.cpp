// SPDX-License-Identifier: Apache-2.0
// Each limit: kNone within it, its fault beyond it; torques that may be written are within bounds.
#include "runtime/device/four_legs/mechanism_limits.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <utility>

#include "runtime/device/four_legs/kinematics.h"
#include "tests/support/device_workspace.h"
#include "tests/support/uniform.h"

namespace trocar::runtime {
namespace {

using trocar::test::uniform;

TEST(MechanismLimits, SingularityIsALimitOnConditionAndBranchDistance) {
  const MechanismLimits limits;
  for (double Singularity::*measure :
       {&Singularity::inverse_condition, &Singularity::nearest_branch_m}) {
    Singularity at;
    at.inverse_condition = at.nearest_branch_m = 1;
    ASSERT_EQ(check_singularity(limits, at), Fault::kNone);
    for (const double beyond : {-1.0, -1e-9, static_cast<double>(NAN)}) {
      at.*measure = beyond + (measure == &Singularity::inverse_condition ? 0.02 : 0.5e-3);
      EXPECT_EQ(check_singularity(limits, at), Fault::kSingularity) << beyond;
    }
    at.*measure = measure == &Singularity::inverse_condition ? 0.02 : 0.5e-3;
    EXPECT_EQ(check_singularity(limits, at), Fault::kNone) << "at its limit";
  }
}

// All poses of the stated workspace are usable. Beyond it some poses are found by the branch
// distance alone, since their condition number is still good.
TEST(MechanismLimits, TheStatedWorkspaceKeepsItsDistanceFromSingularities) {
  const MechanismLimits limits;
  const DeviceDescription device = default_device_description();
  const auto at = [&](const Pose& T, Singularity& singularity) {
    const InverseResult inverse = inverse_kinematics(device, T);
    if (!inverse.status || !check_joint_limits(device, encoder_angles(inverse.joints)))
      return false;
    const JacobianResult motion = jacobian(device, T, inverse.joints);
    singularity = measure_singularity(device, T, inverse.joints, motion.G);
    return true;
  };
  testing_support::Random random(31);
  double least_m = 1;
  for (int i = 0; i < 100'000; ++i) {
    Singularity found;
    ASSERT_TRUE(at(testing_support::random_workspace_pose(random), found));
    ASSERT_EQ(check_singularity(limits, found), Fault::kNone);
    least_m = std::min(least_m, found.nearest_branch_m);
  }
  EXPECT_LT(least_m, 1e-3) << "close enough that the limit has a purpose";
  int by_distance_alone = 0;
  for (int i = 0; i < 100'000; ++i) {
    Singularity found;
    const testing_support::Workspace box = {0.06, 0.24, 0.06, 0.6};
    if (!at(testing_support::random_workspace_pose(random, box), found)) continue;
    by_distance_alone += found.inverse_condition >= limits.inverse_condition_min &&
                         check_singularity(limits, found) == Fault::kSingularity;
  }
  EXPECT_GT(by_distance_alone, 50);
}

TEST(MechanismLimits, ThermalLimitIsExceededAfterThePeakTime) {
  const DeviceDescription device = default_device_description();
  const MotorModel motor = make_motor_model(device);
  for (const double rate_Hz : {500.0, 1000.0, 8000.0}) {
    for (int i = 0; i < kMotors; ++i) {
      MotorState state;
      MotorVector tau = MotorVector::Zero();
      tau[i] = i % 2 == 0 ? device.motor_continuous_torque_Nm : -device.motor_continuous_torque_Nm;
      for (int k = 0; k < 20 * rate_Hz; ++k)
        ASSERT_EQ(check_heat(motor, tau, 1 / rate_Hz, state), Fault::kNone);
      EXPECT_NEAR(i2t_fraction_used(motor, state.load), 0, 1e-9)
          << "the continuous torque, for any time";
      state = {};
      tau[i] *= 2;  // the peak torque, which limit_torques would not allow for so long
      int ticks = 0;
      while (check_heat(motor, tau, 1 / rate_Hz, state) == Fault::kNone)
        ASSERT_LT(++ticks, 20000);
      EXPECT_NEAR(ticks / rate_Hz, device.motor_peak_time_s, 2 / rate_Hz);
    }
    if (rate_Hz > 1000) break;
  }
}

TEST(MechanismLimits, DeratedMotorsThatRenderTooLittleForTooLongAreOverloaded) {
  const MechanismLimits limits;
  const MotorModel motor = make_motor_model(default_device_description());
  for (const double rate_Hz : {500.0, 1000.0, 8000.0}) {
    const double dt_s = 1 / rate_Hz;
    MotorState cold;
    for (int k = 0; k < 3 * rate_Hz; ++k)
      ASSERT_EQ(check_overload(limits, motor, 0.1, dt_s, cold), Fault::kNone)
          << "not derated: this wrench was never possible";
    MotorState hot;
    hot.load.excess_A2s[5] =
        0.9 * (motor.peak_A.cwiseAbs2() - motor.continuous_A.cwiseAbs2())[5] * motor.peak_time_s;
    for (int k = 0; k < 3 * rate_Hz; ++k)
      ASSERT_EQ(check_overload(limits, motor, 0.5, dt_s, hot), Fault::kNone);
    for (int k = 0; k < 3 * rate_Hz; ++k)  // a tick that renders enough starts the time again
      ASSERT_EQ(check_overload(limits, motor, k % 400 == 0 ? 1 : 0.1, dt_s, hot), Fault::kNone);
    ASSERT_EQ(check_overload(limits, motor, 1, dt_s, hot), Fault::kNone);
    int ticks = 0;
    while (check_overload(limits, motor, 0.49, dt_s, hot) == Fault::kNone)
      ASSERT_LT(++ticks, 20000);
    EXPECT_NEAR(ticks * dt_s, limits.overload_time_max_s, 1.1 * dt_s);
    EXPECT_EQ(check_overload(limits, motor, NAN, dt_s, hot), Fault::kMotorOverload);
  }
}

// Item 1, with zero torques wanted: limits of nan, and negative limits.
TEST(MechanismLimits, ALimitOfNanOrANegativeLimitAlwaysTrips) {
  const MotorModel motor = make_motor_model(default_device_description());
  const auto found = [&](const MechanismLimits& limits) -> Fault {
    MotorState state;
    MotorVector wanted = MotorVector::Zero();
    if (const Fault f = check_overload(limits, motor, 1, 1e-3, state); f != Fault::kNone) return f;
    return limit_torques(limits, motor.peak_Nm, MotorVector::Zero(), 1e-3, wanted, state);
  };
  ASSERT_EQ(found({}), Fault::kNone);
  using Limit = double MechanismLimits::*;
  for (const auto& [limit, fault] :
       {std::pair<Limit, Fault>{&MechanismLimits::overload_time_max_s, Fault::kMotorOverload},
        {&MechanismLimits::torque_max_Nm, Fault::kTorqueLimit},
        {&MechanismLimits::torque_rise_max_Nm_per_s, Fault::kTorqueRate},
        {&MechanismLimits::torque_rise_time_max_s, Fault::kTorqueRate}}) {
    for (const double bad : {static_cast<double>(NAN), -0.1, -static_cast<double>(INFINITY)}) {
      MechanismLimits limits;
      limits.*limit = bad;
      EXPECT_EQ(found(limits), fault) << to_string(fault) << " at " << bad;
    }
  }
}

TEST(MechanismLimits, TorquesThatMayBeWrittenAreAlwaysWithinBounds) {
  std::mt19937_64 random(17);
  MechanismLimits limits;
  limits.torque_rise_time_max_s = 1e9;
  constexpr double kPeak_Nm = 6;
  MotorVector last = MotorVector::Zero();
  MotorState state;
  int refused = 0, shortened = 0, unchanged = 0, scaled = 0;
  for (int i = 0; i < 20000; ++i) {
    limits.torque_rise_max_Nm_per_s = i % 3 == 0 ? 1e9 : 800;
    MotorVector wanted, limit_Nm;
    for (int k = 0; k < kMotors; ++k) {
      limit_Nm[k] = kPeak_Nm * (1 - 0.6 * uniform(random));  // the last torques may be beyond it
      wanted[k] = (uniform(random) - 0.5) * (i % 7 == 0 ? 2.2 : 1.9) * limit_Nm[k];
    }
    const MotorVector before = wanted;
    const bool too_much = wanted.cwiseQuotient(limit_Nm).cwiseAbs().maxCoeff() > 1 + 1e-9;
    const Fault fault = limit_torques(limits, limit_Nm, last, 1e-3, wanted, state);
    ASSERT_EQ(fault, too_much ? Fault::kTorqueLimit : Fault::kNone);
    if (fault != Fault::kNone) {
      ++refused;
      continue;
    }
    ASSERT_TRUE((wanted.cwiseAbs().array() <= limit_Nm.array()).all());
    ++(wanted == before ? unchanged : shortened);
    bool by_rate = false;
    const MotorVector slower =
        limit_rise(last, before, limits.torque_rise_max_Nm_per_s * 1e-3, by_rate);
    const double share = slower.norm() > 0 ? wanted.norm() / slower.norm() : 1;
    ASSERT_LE(share, 1 + 1e-12);
    ASSERT_LT((wanted - share * slower).cwiseAbs().maxCoeff(), 1e-12)
        << "one factor for all motors";
    scaled += share < 1 - 1e-12;
    last = wanted;
  }
  EXPECT_GT(refused, 100);
  EXPECT_GT(shortened, 100);
  EXPECT_GT(unchanged, 100);
  EXPECT_GT(scaled, 100);
  for (const double bad : {static_cast<double>(NAN), static_cast<double>(INFINITY)}) {
    MotorVector wanted = MotorVector::Zero();
    wanted[3] = bad;
    EXPECT_EQ(limit_torques(limits, MotorVector::Constant(kPeak_Nm), last, 1e-3, wanted, state),
              Fault::kTorqueNotFinite);
  }
}

/// Growth of a motor's torque in magnitude, or its part beyond zero after a change of sign.
double rise_of(double from_Nm, double to_Nm) {
  return from_Nm * to_Nm > 0 ? std::max(0.0, std::abs(to_Nm) - std::abs(from_Nm)) : std::abs(to_Nm);
}

double largest_rise(const MotorVector& from, const MotorVector& to) {
  double largest = 0;
  for (int k = 0; k < kMotors; ++k)
    largest = std::max(largest, rise_of(from[k], to[k]));
  return largest;
}

// Random torques, among them reversals, releases and steps that end exactly at the limit. Within
// the limit nothing changes; beyond it the step is shortened; what comes out is never beyond it.
TEST(LimitRise, WithinItChangesNothingBeyondItActsAndItsResultIsWithinIt) {
  std::mt19937_64 random(41);
  int within = 0, beyond = 0, reversed = 0, released = 0;
  for (int i = 0; i < 100'000; ++i) {
    MotorVector last, wanted;
    for (int k = 0; k < kMotors; ++k) {
      last[k] = i % 11 == 0 ? 0 : 12 * (uniform(random) - 0.5);
      wanted[k] = 12 * (uniform(random) - 0.5);
    }
    if (i % 4 == 1) wanted = -2 * uniform(random) * last;
    if (i % 4 == 2) wanted = uniform(random) * last;
    const double rise_Nm = i % 5 == 0 ? largest_rise(last, wanted) : 8 * uniform(random);
    const bool grows = wanted.cwiseAbs().maxCoeff() > last.cwiseAbs().maxCoeff();
    const bool steps = grows && (wanted - last).cwiseAbs().maxCoeff() > rise_Nm;
    bool shortened = false;
    const MotorVector got = limit_rise(last, wanted, rise_Nm, shortened);
    ASSERT_LE(largest_rise(last, got), rise_Nm * (1 + 1e-12) + 1e-14);
    if (steps || largest_rise(last, wanted) > rise_Nm) {
      ASSERT_TRUE(shortened);
      ASSERT_NE(got, wanted);
      const double share = (got - last).norm() / (wanted - last).norm();
      ASSERT_LT(share, 1);
      ASSERT_LT((got - last - share * (wanted - last)).norm(), 1e-12) << "one factor";
      // No shorter than needed.
      const double taken_Nm = grows ? (got - last).cwiseAbs().maxCoeff() : largest_rise(last, got);
      ASSERT_NEAR(taken_Nm, rise_Nm, 1e-12);
      ++beyond;
      reversed += !grows;
    } else {
      ASSERT_FALSE(shortened);
      ASSERT_EQ(got, wanted);
      ++within;
      released += largest_rise(last, wanted) == 0 && i % 4 == 2;
    }
  }
  EXPECT_GT(within, 10'000);
  EXPECT_GT(beyond, 10'000);
  EXPECT_GT(reversed, 1'000);
  EXPECT_GT(released, 10'000);
}

TEST(MechanismLimits, AWallThatOscillatesAtTheRateLimitIsAFault) {
  const MechanismLimits limits;
  MotorState state;
  MotorVector last = MotorVector::Zero();
  Fault fault = Fault::kNone;
  int tick = 0;
  for (; tick < 1000 && fault == Fault::kNone;
       ++tick) {  // alternately the largest torque and none: the release does not reset the time
    MotorVector wanted = MotorVector::Constant(tick % 2 == 0 ? 5.9 : 0);
    fault = limit_torques(limits, MotorVector::Constant(6), last, 1e-3, wanted, state);
    last = wanted;
  }
  EXPECT_EQ(fault, Fault::kTorqueRate);
  EXPECT_LE(tick, 50);
  EXPECT_GE(tick, 30);
}

}  // namespace
}  // namespace trocar::runtime
