// SPDX-License-Identifier: Apache-2.0
// Torques of the loop with warm motors, and with compensation of friction and weight.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "tests/runtime/haptics/loop/loop_fixture.h"

namespace trocar::runtime {
namespace {

using testing_support::largest;

class LoopMotors : public testing_support::LoopFixture {
 protected:
  /// Presses with hot motors until kMotorOverload is raised, and waits until torques are zero.
  /// Returns the number of ticks to the fault.
  int overload() {
    description_.motor_continuous_torque_Nm = 0.3 * largest(good_);
    description_.motor_peak_torque_Nm = 1.5 * largest(good_);
    description_.motor_peak_time_s = 0.02;
    mechanism_.overload_time_max_s = 0.05;
    int ticks = 0;
    for (; state_.safety.fault == Fault::kNone && ticks < 1000; ++ticks)
      tick();
    EXPECT_EQ(state_.safety.fault, Fault::kMotorOverload);
    for (int i = 0; i < 10; ++i)
      tick();
    return ticks;
  }
  /// Requests recovery in free space. It must wait until the motors have cooled.
  void expect_rest_before_running() {
    recover_ = true;
    tick();
    recover_ = false;
    EXPECT_EQ(state_.safety.state, SafetyState::kRecovering);
    allow_jumps(true);
    go_to(0.121);
    tick();
    ASSERT_GT(result_.row.motor_heat_max, 0.6);
    for (int i = 0; result_.row.motor_heat_max > 0.5; ++i) {
      ASSERT_LT(i, 5000);
      ASSERT_EQ(state_.safety.quiet_ticks, 0U) << "still warm: the quiet time has not begun";
      tick();
    }
    for (int i = 0; i < 300; ++i)
      tick();
    EXPECT_EQ(state_.safety.state, SafetyState::kRunning);
  }
};

// The force falls along its own direction to what the continuous torque gives, without a fault, and
// returns once the motors have cooled.
TEST_F(LoopMotors, WarmMotorsAreDeratedSmoothlyAndRecover) {
  DeviceDescription& device = description_;
  device.motor_continuous_torque_Nm = 0.7 * largest(good_);
  device.motor_peak_time_s = 0.2;
  device.motor_peak_torque_Nm = 1.5 * largest(good_);
  double last_N = result_.row.wrench_delivered[2], largest_step_N = 0, heat = 0;
  for (int i = 0; i < 2000; ++i) {
    tick();
    ASSERT_EQ(state_.safety.fault, Fault::kNone) << i;
    for (int k = 0; k < 6; ++k) {
      ASSERT_NEAR(result_.row.wrench_delivered[k],
                  result_.row.wrench_scale * result_.row.wrench_wanted[k], 1e-9);
    }
    largest_step_N = std::max(largest_step_N, std::abs(result_.row.wrench_delivered[2] - last_N));
    last_N = result_.row.wrench_delivered[2];
    heat = std::max(heat, result_.row.motor_heat_max);
  }
  EXPECT_LT(largest(device_.written), 1.01 * device.motor_continuous_torque_Nm);
  EXPECT_GT(largest(device_.written), 0.98 * device.motor_continuous_torque_Nm);
  EXPECT_NEAR(last_N, 20 * 0.7, 0.4);
  EXPECT_LT(largest_step_N, 0.5);
  EXPECT_GT(heat, 0.95);
  EXPECT_LE(heat, 1 + 1e-9);
  allow_jumps(true);
  go_to(0.125);
  for (int i = 0; i < 2000; ++i)
    tick();
  go_to(0.116);
  tick();
  EXPECT_NEAR(result_.row.wrench_delivered[2], 20, 1e-9);
}

TEST_F(LoopMotors, MotorOverloadWhenDeratedMotorsRenderTooLittleForTooLong) {
  const int ticks = overload();
  EXPECT_GT(ticks, 50);
  EXPECT_LT(ticks, 150);
  expect_rest_before_running();
}

TEST_F(LoopMotors, AnEmergencyStopAfterMotorOverloadLetsTheMotorsCool) {
  overload();
  outside_ = Fault::kEmergencyStop;
  tick();
  outside_ = Fault::kNone;
  ASSERT_EQ(state_.safety.fault, Fault::kEmergencyStop);
  expect_rest_before_running();
}

TEST_F(LoopMotors, MotorOverloadWhenAThermalLimitIsExceeded) {
  description_.motor_continuous_torque_Nm = 0.01;
  description_.motor_peak_time_s = 1e-9;  // shorter than a tick: derating comes too late
  expect_fault(Fault::kMotorOverload);
}

// Compensation is added to the rendered torques, kept apart from them in the recording, rises
// slowly from zero, and never exceeds a limit.
TEST_F(LoopMotors, CompensationRisesSlowlyAndKeepsTheLimits) {
  model_.compensation.gravity = true;
  description_.gravity_m_per_s2 = 9.81;
  double last_N = 0;
  for (int i = 1; i <= 400; ++i) {
    tick();
    ASSERT_EQ(state_.safety.fault, Fault::kNone);
    ASSERT_NEAR(result_.row.wrench_delivered[2], 20, 1e-9);
    const Wrench all = four_legs_->motor_jacobian().transpose() *
                       MotorVector(result_.row.tau_Nm.data());
    ASSERT_NEAR(all[2] - 20, std::min(1.0, i / 250.0) * 0.35 * 9.81, 1e-6);
    ASSERT_GE(all[2], last_N);
    last_N = all[2];
  }
  const double limit_Nm = 0.9 * largest(device_.written);
  description_.motor_peak_torque_Nm = description_.motor_continuous_torque_Nm = limit_Nm;
  tick();
  EXPECT_LE(largest(device_.written), limit_Nm);
  EXPECT_LT(result_.row.wrench_scale, 1);
  for (int k = 0; k < 6; ++k) {
    EXPECT_NEAR(result_.row.wrench_delivered[k],
                result_.row.wrench_scale * result_.row.wrench_wanted[k], 1e-9);
  }
}

TEST_F(LoopMotors, MotorOverloadWhenTheWeightAloneExceedsTheAvailableTorque) {
  model_.compensation.gravity = true;
  description_.gravity_m_per_s2 = 9.81;
  description_.plate_mass_kg = 10;
  model_.limits.timing.ramp_up_s = 0;
  mechanism_.overload_time_max_s = 1e9;
  tick();
  ASSERT_EQ(state_.safety.fault, Fault::kNone);
  description_.motor_continuous_torque_Nm =
      0.5 * four_legs_->compensation_Nm().cwiseAbs().maxCoeff();
  description_.motor_peak_time_s = 0.02;
  int ticks = 0;
  for (; state_.safety.fault == Fault::kNone; ++ticks) {
    ASSERT_LT(ticks, 2000);
    tick();
  }
  EXPECT_GT(ticks, 10);
  EXPECT_EQ(state_.safety.fault, Fault::kMotorOverload);
}

TEST_F(LoopMotors, FrictionCompensationFollowsTheMotorRates) {
  model_.compensation.friction = true;
  description_.joint_coulomb_friction_Nm = 0.1;
  model_.limits.timing.ramp_up_s = 0;
  double z_m = 0.116;
  for (int i = 0; i < 60; ++i) {
    go_to(z_m += 0.1e-3);
    tick();
    ASSERT_EQ(state_.safety.fault, Fault::kNone);
  }
  const MotorVector rate = four_legs_->motor_jacobian() * state_.speed.twist_device;
  for (int i = 0; i < kMotors; ++i) {
    ASSERT_GT(std::abs(rate[i]), 0.1) << "above the rate at which compensation is complete";
    EXPECT_NEAR(four_legs_->compensation_Nm()[i],
                0.8 * (std::copysign(0.1, rate[i]) +
                       description_.joint_viscous_friction_Nms_per_rad * rate[i]),
                1e-12);
  }
}

}  // namespace
}  // namespace trocar::runtime
