// SPDX-License-Identifier: Apache-2.0
// The laws of runtime/device/four_legs/mechanism_limits.h.
#include "runtime/device/four_legs/mechanism_limits.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "tests/support/device_workspace.h"

namespace trocar::runtime {
namespace {

using testing_support::Random;
using testing_support::random_workspace_pose;

constexpr double kMotorTick_s = 1e-3;

TEST(MotorModel, JointTorqueIsCurrentTimesConstantAndGears) {
  DeviceDescription device = default_device_description();
  device.upper_bevel_ratio = 1.5;
  const MotorModel model = make_motor_model(device);
  const MotorVector tau = motor_currents(model, MotorVector::Constant(0.9));
  for (int m = 0; m < kLegs; ++m) {
    EXPECT_NEAR(tau[motor_index(m, 0)], 0.9 / (0.06 * 18 * 1.5), 1e-12) << "by the bevel gears";
    EXPECT_NEAR(tau[motor_index(m, 1)], 0.9 / (0.06 * 18), 1e-12);
  }
}

TEST(MotorModel, PeakIsTheLowerOfDriveAndJointLimit) {
  DeviceDescription device = default_device_description();
  // The described drive could give more than the joint's peak torque.
  MotorModel model = make_motor_model(device);
  EXPECT_EQ(available_torque(model, {}), MotorVector::Constant(6)) << "to the bit, when cold";
  EXPECT_LT(model.peak_A[0], device.motor_peak_current_A);
  // A weaker drive limits the torque.
  device.motor_peak_current_A = 4;
  device.motor_continuous_current_A = 2;
  model = make_motor_model(device);
  EXPECT_NEAR(available_torque(model, {})[0], 4 * 1.08, 1e-12);
  MotorLoad used_up;
  used_up.excess_A2s.setConstant(1e6);
  EXPECT_NEAR(available_torque(model, used_up)[0], 2 * 1.08, 1e-12);
}

// Law 1 by brute force over every interval of a session. The wanted current is above the peak,
// below it and zero; the applied one is clamped to the available current.
TEST(MotorLoad, SquaredCurrentOverAnyIntervalIsBounded) {
  const MotorModel model = make_motor_model(default_device_description());
  Random random(51);
  const double low2 = model.continuous_A[0] * model.continuous_A[0];
  const double capacity = (model.peak_A[0] * model.peak_A[0] - low2) * model.peak_time_s;
  MotorLoad load;
  std::vector<double> excess = {0};  // integral of I^2 - continuous^2 from the start
  double wanted_A = 0, last_A = model.peak_A[0], fastest_A_per_s = 0;
  for (int tick = 0; tick < 60'000; ++tick) {
    if (tick % 500 == 0) {
      wanted_A =
          random.unit() < 0.6 ? 2 * model.peak_A[0] : random.between(-1, 1) * model.peak_A[0];
      if (tick > 20'000 && tick < 30'000) wanted_A = 0;
    }
    const MotorVector available = available_current(model, load);
    ASSERT_GE(available[0], model.continuous_A[0] - 1e-12);
    ASSERT_LE(available[0], model.peak_A[0]);
    fastest_A_per_s = std::max(fastest_A_per_s, std::abs(available[0] - last_A) / kMotorTick_s);
    last_A = available[0];
    const double current_A = std::clamp(wanted_A, -available[0], available[0]);
    load = advance(model, load, MotorVector::Constant(current_A), kMotorTick_s);
    excess.push_back(excess.back() + (current_A * current_A - low2) * kMotorTick_s);
  }
  double lowest = 0, worst = 0;
  for (const double each : excess) {
    lowest = std::min(lowest, each);
    worst = std::max(worst, each - lowest);
  }
  EXPECT_LE(worst, capacity * (1 + 1e-9));
  EXPECT_GT(worst, 0.95 * capacity) << "the capacity is not used";
  EXPECT_LT(fastest_A_per_s, 0.01 / kMotorTick_s) << "law 2: without jumps";
}

TEST(MotorLoad, CurrentThatIsNotFiniteCountsAsThePeak) {
  const MotorModel model = make_motor_model(default_device_description());
  MotorVector current = model.peak_A;
  const MotorLoad expected = advance(model, {}, current, kMotorTick_s);
  current[2] = std::numeric_limits<double>::quiet_NaN();
  current[5] = -std::numeric_limits<double>::infinity();
  EXPECT_EQ(advance(model, {}, current, kMotorTick_s).excess_A2s, expected.excess_A2s);
}

TEST(MotorLoad, PeakEqualToContinuousGivesAConstantLimit) {
  DeviceDescription device = default_device_description();
  device.motor_peak_current_A = device.motor_continuous_current_A = 2;
  const MotorModel model = make_motor_model(device);
  EXPECT_EQ(available_current(model, {}), MotorVector::Constant(2));
}

TEST(Compensation, FrictionPartIsContinuousInTheRateAndBelowTheFriction) {
  DeviceDescription device = default_device_description();
  device.joint_coulomb_friction_Nm = 0.1;
  device.joint_viscous_friction_Nms_per_rad = 0.02;
  const MotorModel model = make_motor_model(device);
  const auto torque = [&](double rate) {
    return compensation_torques(device, model, Jacobian::Zero(), MotorVector::Constant(rate),
                                {.friction = true})[4];
  };
  EXPECT_EQ(torque(0), 0);
  EXPECT_NEAR(torque(3), 0.8 * (0.1 + 0.06), 1e-12);
  EXPECT_NEAR(torque(-3), -torque(3), 1e-15);
  double last = torque(-0.2);
  for (int i = 0; i < 4000; ++i) {
    const double rate = -0.2 + 1e-4 * i;
    EXPECT_LE(std::abs(torque(rate)),
              0.8 * (0.1 * std::min(1.0, std::abs(rate) / 0.05) + 0.02 * std::abs(rate)) + 1e-12);
    EXPECT_LT(std::abs(torque(rate) - last), 1e-3);
    last = torque(rate);
  }
  EXPECT_EQ(torque(std::numeric_limits<double>::quiet_NaN()), 0);
}

// The rendered part keeps its direction, and the sum keeps the limits.
TEST(Compensation, AllocationWithBiasKeepsDirectionAndLimits) {
  const DeviceDescription device = default_device_description();
  Random random(53);
  int scaled = 0;
  for (int n = 0; n < 5000; ++n) {
    const Pose T = random_workspace_pose(random);
    const Jacobian G = jacobian(device, T, inverse_kinematics(device, T).joints).G;
    Wrench wanted;
    wanted << random.between(0, 120) * random.direction(), 2 * random.in_ball();
    MotorVector bias, limit;
    for (int i = 0; i < kMotors; ++i) {
      bias[i] = random.between(-1, 1);
      limit[i] = random.between(3, 6);
    }
    const AllocationResult result = allocate_torques_with_bias(G, wanted, limit, bias);
    ASSERT_NE(result.kind, AllocationKind::kRefused);
    ASSERT_TRUE((result.tau_motor_Nm.cwiseAbs().array() <= limit.array()).all());
    const Wrench rendered = G.transpose() * (result.tau_motor_Nm - bias);
    ASSERT_LT((rendered - result.scale * wanted).norm(), 1e-9 * wanted.norm());
    ASSERT_LT((rendered - result.wrench_device).norm(), 1e-9 * wanted.norm());
    scaled += result.scale < 1;
  }
  EXPECT_GT(scaled, 500);
  const Jacobian G = Jacobian::Identity();
  EXPECT_EQ(
      allocate_torques_with_bias(G, Wrench::Ones(), MotorVector::Ones(), MotorVector::Ones()).kind,
      AllocationKind::kRefused);
  EXPECT_EQ(allocate_torques_with_bias(G, Wrench::Ones(), MotorVector::Ones(),
                                       MotorVector::Constant(std::nan("")))
                .tau_motor_Nm,
            MotorVector::Zero());
}

}  // namespace
}  // namespace trocar::runtime
