// SPDX-License-Identifier: Apache-2.0
// What a tick says of a fault that it finds: which sensor or quantity, its value, its limit; and
// how far the tool must be lifted before forces may return.
#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <string>

#include "tests/runtime/haptics/loop/loop_fixture.h"

namespace trocar::runtime {
namespace {

class LoopFound : public testing_support::LoopFixture {
 protected:
  /// The next tick finds a fault of this quantity.
  void expect_found(const std::string& quantity, double value, double limit) {
    tick();
    EXPECT_EQ(result_.found.fault, state_.safety.fault);
    EXPECT_EQ(result_.new_fault, state_.safety.fault);
    EXPECT_EQ(quantity_name(result_.found), quantity);
    EXPECT_NEAR(result_.found.value, value, 1e-9) << measured(result_.found);
    EXPECT_NEAR(result_.found.limit, limit, 1e-12) << measured(result_.found);
  }
};

TEST_F(LoopFound, NothingInAGoodTick) {
  tick();
  EXPECT_EQ(result_.found.fault, Fault::kNone);
  EXPECT_EQ(quantity_name(result_.found), "");
  EXPECT_NEAR(result_.retract_distance_m, 0.004, 1e-9) << "the tool stands in the sheet";
}

TEST_F(LoopFound, TimeWithoutData) {
  device_.on_read = DeviceStatus::kNoData;
  for (int i = 0; i < 9; ++i)
    tick();
  expect_found("time_without_data_s", 0.01, 0.01);
}

// The link drops states with such contents, so that no data comes.
TEST_F(LoopFound, TheFieldForWhichStatesAreRefused) {
  device_.on_read = DeviceStatus::kNoData;
  device_.refused = {Fault::kRefusedState, FaultQuantity::kEncoderAngle, 6, NAN, 1000};
  for (int i = 0; i < 9; ++i) {
    tick();
    ASSERT_EQ(result_.found.fault, Fault::kNone) << "one refused state is no fault";
  }
  tick();
  EXPECT_EQ(state_.safety.fault, Fault::kRefusedState);
  EXPECT_EQ(quantity_name(result_.found), "th_2_3_rad");
  EXPECT_TRUE(std::isnan(result_.found.value));
}

TEST_F(LoopFound, TheFieldForWhichStatesAreRefusedOnALinkThatIsLost) {
  device_.on_read = DeviceStatus::kLinkLost;
  device_.refused = {Fault::kRefusedState, FaultQuantity::kStateMode, -1, 9, 4};
  tick();
  EXPECT_EQ(state_.safety.fault, Fault::kRefusedState);
  EXPECT_EQ(measured(result_.found), "mode 9, limit 4");
}

TEST_F(LoopFound, TheEncoderThatJumps) {
  device_.next.encoder_rad[6] -= 0.3;
  expect_found("th_2_3_step_rad", 0.3, 0.06);
}

TEST_F(LoopFound, TheEncoderThatGivesNoNumber) {
  device_.next.encoder_rad[13] = NAN;
  tick();
  EXPECT_EQ(quantity_name(result_.found), "th_4_2_rad");
  EXPECT_TRUE(std::isnan(result_.found.value));
}

TEST_F(LoopFound, TheJointAndTheBoundThatItIsBeyond) {
  mechanism_.encoder_rate_max_rad_per_s = 1e6;
  const JointLimit limit = description_.joint_limit[0];
  device_.next.encoder_rad[8] = limit.min_rad - 0.01;
  expect_found("th_3_1_rad", limit.min_rad - 0.01, limit.min_rad);
}

TEST_F(LoopFound, TheMisfitOfTheUpperChains) {
  device_.next.encoder_rad[1] += 0.05;
  tick();
  EXPECT_EQ(quantity_name(result_.found), "pose_residual_m");
  EXPECT_GT(result_.found.value, result_.found.limit);
  EXPECT_EQ(result_.found.limit, mechanism_.pose_residual_max_m);
}

TEST_F(LoopFound, TheLowerEncoderThatContradictsThePose) {
  device_.next.encoder_rad[11] += 0.05;
  tick();
  EXPECT_EQ(quantity_name(result_.found), "th_3_4_residual_rad");
  EXPECT_NEAR(result_.found.value, 0.05, 1e-6);
  EXPECT_EQ(result_.found.limit, mechanism_.theta4_residual_max_rad);
}

TEST_F(LoopFound, TheInverseConditionOrTheLegNearItsEnd) {
  mechanism_.inverse_condition_min = 0.999;
  tick();
  EXPECT_EQ(quantity_name(result_.found), "inverse_condition");
  EXPECT_LT(result_.found.value, 0.999);
}

TEST_F(LoopFound, TheLegNearTheEndOfItsReach) {
  mechanism_.branch_distance_min_m = 0.2;
  tick();
  EXPECT_EQ(quantity_name(result_.found).rfind("branch_distance_", 0), 0U);
  EXPECT_GE(result_.found.index, 0);
  EXPECT_LT(result_.found.value, 0.2);
}

TEST_F(LoopFound, TheGapOrTheNumberOfMissedDeadlines) {
  missed_in_row_ = 3;
  expect_found("missed_deadlines_in_row", 3, 2);
  EXPECT_EQ(result_.row.outside_fault, Fault::kDeadlineMissed);
}

TEST_F(LoopFound, TheGap) {
  tick(0.25);
  EXPECT_EQ(quantity_name(result_.found), "tick_gap_s");
  EXPECT_EQ(result_.found.value, 0.25);
  EXPECT_EQ(result_.found.limit, 0.1);
}

TEST_F(LoopFound, TheAxisOfTheBox) {
  allow_jumps(true);
  model_.limits.workspace_max_m[0] = 0.01;
  go_to(0.116, 0.0101);
  expect_found("x_m", 0.0101, 0.01);
}

TEST_F(LoopFound, TheSpeed) {
  tick();
  model_.limits.speed_max_m_per_s = 0;
  go_to(0.1159);
  tick();
  EXPECT_EQ(quantity_name(result_.found), "plate_speed_m_per_s");
  EXPECT_GT(result_.found.value, 0);
}

TEST_F(LoopFound, TheMotorBeyondItsTorque) {
  mechanism_.torque_max_Nm = 0.5 * testing_support::largest(good_);
  tick();
  EXPECT_EQ(quantity_name(result_.found).rfind("tau_", 0), 0U);
  EXPECT_EQ(result_.found.limit, mechanism_.torque_max_Nm);
  EXPECT_GT(result_.found.value, result_.found.limit);
}

TEST_F(LoopFound, TheTiltOfTheTool) {
  SceneTool shape;
  shape.tilt_deg = 45;
  use_tool(make_tool(shape));
  Pose pose;
  pose.p_m = {0, 0, 0.116};
  pose.q = Eigen::AngleAxisd(0.01, Eigen::Vector3d::UnitY());
  device_.next.encoder_rad = encoder_angles(inverse_kinematics(description_, pose).joints);
  tick();
  ASSERT_EQ(state_.safety.fault, Fault::kToolTilt);
  EXPECT_EQ(quantity_name(result_.found), "tool_tilt_rad");
  EXPECT_NEAR(result_.found.value - result_.found.limit, 0.01, 1e-6);
}

TEST_F(LoopFound, TheEnergyGivenToTheHand) {
  tick();
  model_.limits.energy_limit_J = 1e-5;
  go_to(0.1165);  // 20 N over 0.5 mm; the jump into the sheet took nothing from the hand
  expect_found("energy_released_J", 0.01, 1e-5);
}

TEST_F(LoopFound, TheMotorThatTheDriveReports) {
  device_.on_read = DeviceStatus::kMotorFault;
  device_.motors = 0b1000'0100;  // theta1 of leg 2, theta4 of leg 4
  tick();
  EXPECT_EQ(state_.safety.fault, Fault::kMotorFault);
  EXPECT_EQ(quantity_name(result_.found), "motor_2_1");
}

TEST_F(LoopFound, AWriteThatFails) {
  device_.on_write = DeviceStatus::kNoData;
  expect_found("", 0, 0);
  EXPECT_EQ(result_.found.fault, Fault::kWriteFailed);
}

TEST_F(LoopFound, WhatPreventsARecovery) {
  device_.next.encoder_rad[6] -= 0.3;
  for (int i = 0; i < 6; ++i)
    tick();
  ASSERT_TRUE(result_.torques_are_zero);
  go_to(0.116);
  allow_jumps(true);
  recover_ = true;
  tick();
  EXPECT_EQ(state_.safety.state, SafetyState::kRecovering);
  EXPECT_EQ(result_.found.fault, Fault::kNone);
  EXPECT_NEAR(result_.retract_distance_m, 0.004, 1e-9);
  device_.on_read = DeviceStatus::kEmergencyStop;
  tick();
  EXPECT_EQ(result_.found.fault, Fault::kEmergencyStop);
  EXPECT_EQ(result_.new_fault, Fault::kEmergencyStop) << "its release alone must not bring forces";
  EXPECT_EQ(state_.safety.state, SafetyState::kFault);
  EXPECT_EQ(state_.safety.fault, Fault::kEmergencyStop);
  for (int i = 0; i < 3; ++i) {
    tick();
    EXPECT_EQ(state_.safety.state, SafetyState::kFault) << "refused while the stop is held";
    EXPECT_TRUE(result_.recovery_is_refused);
    EXPECT_EQ(result_.row.recovery_asked, 1);
    EXPECT_EQ(result_.new_fault, Fault::kNone) << "held since before the request";
  }
  device_.on_read = DeviceStatus::kOk;
  go_to(0.125);
  tick();
  EXPECT_TRUE(result_.recovery_is_refused) << "not newer than the release";
  tick();
  EXPECT_EQ(state_.safety.state, SafetyState::kRecovering);
  EXPECT_FALSE(result_.recovery_is_refused);
  EXPECT_EQ(result_.found.fault, Fault::kNone);
  EXPECT_EQ(result_.retract_distance_m, 0);
}

}  // namespace
}  // namespace trocar::runtime
