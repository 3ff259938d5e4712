// SPDX-License-Identifier: Apache-2.0
// Single ticks of the haptic loop against a scripted device: every fault by name, the ramp,
// recovery, and the bounds of the torques.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>

#include "runtime/haptics/loop/haptic_loop.h"
#include "tests/runtime/haptics/loop/loop_fixture.h"
#include "tests/support/sheet_fixture.h"

namespace trocar::runtime {
namespace {

using testing_support::largest;
using Loop = testing_support::LoopFixture;

TEST_F(Loop, AGoodTickHasNoFault) {
  go_to(0.1158);
  tick();
  EXPECT_EQ(result_.row.fault, Fault::kNone);
  EXPECT_NEAR(result_.row.wrench_delivered[2], 21, 1e-8);
  EXPECT_EQ(result_.row.t_s, 0.003);
}

TEST_F(Loop, LinkLost) {
  device_.on_read = DeviceStatus::kLinkLost;
  expect_fault(Fault::kLinkLost);
}

TEST_F(Loop, LinkLostInWriting) {
  device_.on_write = DeviceStatus::kLinkLost;
  expect_fault(Fault::kLinkLost);
}

TEST_F(Loop, EndOfDataInWritingIsALostLinkAndCanBeRecorded) {
  device_.on_write = DeviceStatus::kEndOfData;
  expect_fault(Fault::kLinkLost);
  device_.on_write = DeviceStatus::kEndOfData;
  tick();
  EXPECT_EQ(result_.row.device_write, DeviceStatus::kLinkLost);
  EXPECT_STREQ(to_string(result_.row.device_write), "link_lost");
}

TEST_F(Loop, WriteFailed) {
  device_.on_write = DeviceStatus::kNoData;
  expect_fault(Fault::kWriteFailed);
}

TEST_F(Loop, TenMillisecondsWithoutDataAreAFault) {
  for (const double rate_Hz : {500.0, 1000.0, 8000.0}) {
    model_.rate_Hz = rate_Hz;
    device_.on_read = DeviceStatus::kNoData;
    const int most = static_cast<int>(0.01 * rate_Hz) - 1;
    for (int i = 0; i < most; ++i) {
      tick();
      ASSERT_EQ(state_.safety.fault, Fault::kNone);
      ASSERT_EQ(device_.written.tau_motor_Nm, good_.tau_motor_Nm) << "on the last state";
    }
    device_.on_read = DeviceStatus::kOk;
    tick();
    ASSERT_EQ(state_.safety.fault, Fault::kNone);
  }
  model_.rate_Hz = 1000;
  device_.on_read = DeviceStatus::kNoData;
  for (int i = 0; i < 9; ++i)
    tick();
  expect_fault(Fault::kNoData);
}

TEST_F(Loop, TorquesAreZeroBeforeTheFirstData) {
  restart();
  device_.on_read = DeviceStatus::kNoData;
  for (int i = 0; i < 9; ++i) {
    tick();
    EXPECT_EQ(largest(device_.written), 0);
    EXPECT_EQ(state_.safety.state, SafetyState::kIdle);
  }
  tick();
  EXPECT_EQ(state_.safety.fault, Fault::kNoData);
  EXPECT_EQ(largest(device_.written), 0);
}

TEST_F(Loop, EncoderNotFinite) {
  device_.next.encoder_rad[7] = NAN;
  expect_fault(Fault::kEncoderNotFinite);
}

TEST_F(Loop, EncoderNotFiniteInTheFirstTick) {
  restart();
  device_.next.encoder_rad[0] = INFINITY;
  tick();
  EXPECT_EQ(state_.safety.fault, Fault::kEncoderNotFinite);
  EXPECT_EQ(largest(device_.written), 0);
}

TEST_F(Loop, EncoderJump) {
  device_.next.encoder_rad[4] += 0.061;
  expect_fault(Fault::kEncoderJump);
}

TEST_F(Loop, EncoderRateIsTakenOverTheTimeSinceTheLastData) {
  device_.on_read = DeviceStatus::kNoData;
  tick();
  tick();
  device_.on_read = DeviceStatus::kOk;
  go_to(0.107);  // above the limit of one tick, below that of three; 13 mm deep: punctured
  tick();
  EXPECT_EQ(state_.safety.fault, Fault::kNone) << to_string(state_.safety.fault);
}

TEST_F(Loop, JointLimit) {
  const double limit_rad = description_.joint_limit[0].max_rad;
  mechanism_.encoder_rate_max_rad_per_s = 1e6;
  device_.next.encoder_rad[0] = limit_rad + 1e-6;
  expect_fault(Fault::kJointLimit);
}

TEST_F(Loop, PoseResidualOfTheUpperChains) {
  device_.next.encoder_rad[1] += 0.05;  // theta2 of leg 1 contradicts the other legs
  expect_fault(Fault::kPoseResidual);
}

TEST_F(Loop, PoseResidualOfTheLowerMotors) {
  device_.next.encoder_rad[3] += 0.05;  // theta4 of leg 1, which the fit does not use
  expect_fault(Fault::kPoseResidual);
}

TEST_F(Loop, Singularity) {
  mechanism_.inverse_condition_min = 0.999;  // no pose of this device is that good
  expect_fault(Fault::kSingularity);
}

TEST_F(Loop, TorqueNotFinite) {
  auto broken = std::make_unique<Sheet>(*current_[0]);
  broken->tissue.damping_N_s_per_m = INFINITY;
  broken->tissue.threshold_N = INFINITY;
  current_ = {broken.get()};
  go_to(0.1158);
  expect_fault(Fault::kTorqueNotFinite);
}

TEST_F(Loop, DeadlineMissed) {
  tick(0.0999);
  ASSERT_EQ(state_.safety.fault, Fault::kNone);
  expect_fault(Fault::kDeadlineMissed, 0.1001);
}

TEST_F(Loop, ThreeDeadlinesMissedInARow) {
  missed_in_row_ = 2;
  tick();
  ASSERT_EQ(state_.safety.fault, Fault::kNone);
  missed_in_row_ = 3;
  expect_fault(Fault::kDeadlineMissed);
}

TEST_F(Loop, AFaultOfTheCaller) {
  outside_ = Fault::kEmergencyStop;
  tick();
  outside_ = Fault::kNone;
  EXPECT_EQ(result_.row.outside_fault, Fault::kEmergencyStop);
  EXPECT_EQ(state_.safety.fault, Fault::kEmergencyStop);
}

TEST_F(Loop, Workspace) {
  model_.limits.workspace_max_m[0] = 0.01;
  allow_jumps(true);
  go_to(0.116, 0.0099);
  tick();
  ASSERT_EQ(state_.safety.fault, Fault::kNone);
  go_to(0.116, 0.0101);
  expect_fault(Fault::kWorkspace);
}

TEST_F(Loop, Speed) {
  model_.limits.speed_max_m_per_s = 0.2;
  double z_m = 0.116;
  for (int i = 0; i < 40; ++i) {  // at 0.19 m/s
    go_to(z_m += 0.19e-3);
    tick();
    ASSERT_EQ(state_.safety.fault, Fault::kNone) << i;
  }
  int ticks = 0;
  for (; state_.safety.fault == Fault::kNone && ticks < 20; ++ticks) {
    go_to(z_m += 0.3e-3);
    tick();
  }
  EXPECT_EQ(state_.safety.fault, Fault::kSpeed);
  EXPECT_LE(ticks, 2);
}

TEST_F(Loop, TorqueLimit) {
  mechanism_.torque_max_Nm = 1.04 * largest(good_);
  go_to(0.1159);  // 20.5 N
  tick();
  ASSERT_EQ(state_.safety.fault, Fault::kNone);
  good_ = device_.written;
  go_to(0.1150);
  expect_fault(Fault::kTorqueLimit);
}

TEST_F(Loop, TorqueRate) {
  mechanism_.torque_rise_max_Nm_per_s = 1;
  renew_device();
  for (int i = 0; i < 20; ++i) {
    tick();
    ASSERT_EQ(state_.safety.fault, Fault::kNone) << i;
  }
  good_ = device_.written;
  expect_fault(Fault::kTorqueRate);
}

TEST_F(Loop, SingularityNearABranch) {
  mechanism_.branch_distance_min_m = 0.2;  // no pose of this device is that far from one
  expect_fault(Fault::kSingularity);
}

TEST_F(Loop, RecoveryNeedsARequestAndATimeInFreeSpace) {
  device_.next.encoder_rad[4] += 0.061;
  expect_fault(Fault::kEncoderJump);  // the tool stands in the sheet
  for (int i = 0; i < 1000; ++i)
    tick();
  EXPECT_EQ(state_.safety.state, SafetyState::kFault);
  recover_ = true;
  tick();
  recover_ = false;
  EXPECT_EQ(result_.row.recovery_asked, 1);
  for (int i = 0; i < 1000; ++i) {
    tick();
    ASSERT_EQ(state_.safety.state, SafetyState::kRecovering) << "in the sheet";
    ASSERT_EQ(largest(device_.written), 0);
    ASSERT_EQ(result_.row.fault, Fault::kEncoderJump);
  }
  allow_jumps(true);
  go_to(0.121);
  for (int i = 0; i < 200; ++i)
    tick();
  device_.on_read = DeviceStatus::kLinkLost;  // the time starts again
  tick();
  device_.on_read = DeviceStatus::kOk;
  for (int i = 0; i < 249; ++i) {
    tick();
    ASSERT_EQ(state_.safety.state, SafetyState::kRecovering);
  }
  tick();
  EXPECT_EQ(state_.safety.state, SafetyState::kReady);
  tick();
  EXPECT_EQ(state_.safety.state, SafetyState::kRunning);
  EXPECT_EQ(state_.safety.fault, Fault::kNone);
  go_to(0.116);
  double last_N = 0;
  for (int i = 1; i <= 260; ++i) {
    tick();
    ASSERT_EQ(result_.row.fault, Fault::kNone);
    ASSERT_NEAR(result_.row.wrench_delivered[2], 20 * std::min(1.0, i / 250.0), 1e-6);
    last_N = result_.row.wrench_delivered[2];
  }
  EXPECT_NEAR(last_N, 20, 1e-9);
}

TEST_F(Loop, AFaultInTheFirstRunningTickCommandsNoTorques) {
  device_.next.encoder_rad[7] = NAN;
  expect_fault(Fault::kEncoderNotFinite);  // there were 20 N before it
  recover_ = true;
  allow_jumps(true);
  go_to(0.125);
  for (int i = 0; state_.safety.state != SafetyState::kReady && i < 1000; ++i)
    tick();
  ASSERT_EQ(state_.safety.state, SafetyState::kReady);
  law_.model().uses_prefetched_stiffness = true;
  prefetched_.stiffness_N_per_m = INFINITY;
  tick();
  EXPECT_EQ(state_.safety.fault, Fault::kTorqueNotFinite);
  EXPECT_EQ(largest(device_.written), 0) << "the ramp starts from the last command written";
}

TEST_F(Loop, MotionDuringAStopCausesNoFrictionAfterIt) {
  auto sheet = std::make_unique<Sheet>(*sheets_[0]);
  sheet->tissue.shaft.dry_friction_N = 2;
  sheet->tissue.shaft.viscous_friction_N_s_per_m = 30;
  current_ = {sheet.get()};
  allow_jumps(true);
  go_to(0.112);
  tick();
  ASSERT_TRUE(result_.contact.punctured_now);
  go_to(0.1118);
  tick();
  ASSERT_GT(result_.contact.wrench_device.z(), 1) << "friction";
  outside_ = Fault::kEmergencyStop;
  tick();
  outside_ = Fault::kNone;
  for (int i = 0; !result_.torques_are_zero && i < 100; ++i)
    tick();
  recover_ = true;
  go_to(0.108);
  for (int i = 0; state_.safety.state != SafetyState::kRunning && i < 1000; ++i)
    tick();
  ASSERT_EQ(state_.safety.state, SafetyState::kRunning);
  EXPECT_EQ(result_.contact.wrench_device.z(), 0)
      << "the motion of 3.8 mm was almost all before this tick";
  go_to(0.1078);
  tick();
  EXPECT_GT(result_.contact.wrench_device.z(), 1) << "friction in the hole, as before the stop";
}

TEST_F(Loop, RestoreIsCalledWhileRecoveringAndTheDeviceIsLost) {
  for (const DeviceStatus lost : {DeviceStatus::kLinkLost, DeviceStatus::kMotorFault}) {
    device_.restored = 0;
    device_.on_read = lost;
    for (int i = 0; i < 100; ++i)
      tick();
    EXPECT_EQ(state_.safety.state, SafetyState::kFault);
    EXPECT_EQ(device_.restored, 0);
    recover_ = true;
    tick();
    recover_ = false;
    for (int i = 0; i < 9; ++i)
      tick();
    EXPECT_EQ(state_.safety.state, SafetyState::kRecovering);
    EXPECT_EQ(device_.restored, 10) << "in every tick in which it is lost";
    allow_jumps(true);
    go_to(0.121);
    for (const DeviceStatus back : {DeviceStatus::kEmergencyStop, DeviceStatus::kOk}) {
      device_.on_read = back;
      recover_ = back == DeviceStatus::kOk;  // a stop that was pressed meanwhile is a new fault
      for (int i = 0; i < 400; ++i)
        tick();
    }
    recover_ = false;
    EXPECT_EQ(state_.safety.state, SafetyState::kRunning);
    EXPECT_EQ(device_.restored, 10);
  }
}

TEST_F(Loop, ARefusedRequestRestoresTheLinkThatCouldTellTheRelease) {
  device_.on_read = DeviceStatus::kEmergencyStop;
  tick();
  device_.on_read = DeviceStatus::kLinkLost;
  for (int i = 0; i < 20; ++i)
    tick();
  EXPECT_EQ(device_.restored, 0);
  recover_ = true;
  tick();
  recover_ = false;
  EXPECT_TRUE(result_.recovery_is_refused);
  EXPECT_EQ(result_.found.fault, Fault::kLinkLost);
  EXPECT_EQ(device_.restored, 1);
  device_.on_read = DeviceStatus::kOk;
  for (int i = 0; i < 400; ++i)
    tick();
  EXPECT_EQ(state_.safety.state, SafetyState::kFault) << "the request is not kept";
  EXPECT_EQ(state_.safety.fault, Fault::kEmergencyStop);
  recover_ = true;
  tick();
  EXPECT_EQ(state_.safety.state, SafetyState::kRecovering);
}

TEST_F(Loop, AStopDuringAnotherFaultIsReported) {
  for (const bool by_write : {false, true}) {
    device_.next.encoder_rad[7] = NAN;
    for (int i = 0; i < 6; ++i)
      tick();
    ASSERT_EQ(state_.safety.fault, by_write ? Fault::kEmergencyStop : Fault::kEncoderNotFinite);
    (by_write ? device_.on_write : device_.on_read) = DeviceStatus::kEmergencyStop;
    tick();
    EXPECT_EQ(result_.new_fault, Fault::kEmergencyStop);
    EXPECT_EQ(result_.found.fault, Fault::kEmergencyStop);
    EXPECT_EQ(result_.row.fault, Fault::kEmergencyStop);
    tick();
    EXPECT_EQ(result_.new_fault, Fault::kNone) << "held";
    device_.on_read = device_.on_write = DeviceStatus::kOk;
    tick();
    tick();
  }
  EXPECT_EQ(state_.safety.faults, 3U);
}

TEST_F(Loop, ARequestForRecoveryHasNoEffectInOtherStates) {
  recover_ = true;
  for (int i = 0; i < 3; ++i)
    tick();
  EXPECT_EQ(state_.safety.state, SafetyState::kRunning);
  device_.next.encoder_rad[7] = NAN;
  tick();
  tick();
  EXPECT_EQ(state_.safety.state, SafetyState::kFault) << "not while torques are ramped down";
  EXPECT_GT(largest(device_.written), 0);
}

TEST_F(Loop, RemeshBacklog) {
  SheetTrack& track = law_.contact().tracks[0];
  track.pending_count = kMaxPendingHoles;
  track.cuts_requested = kMaxPendingHoles;
  for (LatticeOutline& hole : track.pending) {  // far from the tool
    Pose pose;
    pose.p_m = {0.015, 0.015, 0.1};
    hole = outline_on_lattice(model_.tool, pose, current_[0]->transform, 0.12);
  }
  allow_jumps(true);
  go_to(0.112);
  expect_fault(Fault::kRemeshBacklog);
}

TEST_F(Loop, ToolTilt) {
  SceneTool shape;
  shape.tilt_deg = 45;
  use_tool(make_tool(shape));
  tick();
  ASSERT_EQ(state_.safety.fault, Fault::kNone);
  good_ = device_.written;
  Pose pose;
  pose.p_m = {0, 0, 0.116};
  pose.q = Eigen::AngleAxisd(0.01, Eigen::Vector3d::UnitY());
  const InverseResult inverse = inverse_kinematics(description_, pose);
  ASSERT_TRUE(inverse.status);
  device_.next.encoder_rad = encoder_angles(inverse.joints);
  expect_fault(Fault::kToolTilt);
}

TEST_F(Loop, TheFirstFaultIsKept) {
  device_.next.encoder_rad[7] = NAN;
  tick();
  device_.on_read = DeviceStatus::kLinkLost;
  tick();
  EXPECT_EQ(state_.safety.fault, Fault::kEncoderNotFinite);
  EXPECT_EQ(state_.safety.fault_t_s, 0.003);
}

TEST_F(Loop, TheEndOfTheDataDoesNotCountAsATick) {
  device_.on_read = DeviceStatus::kEndOfData;
  const std::uint64_t ticks = state_.tick;
  tick();
  EXPECT_TRUE(result_.end_of_data);
  EXPECT_EQ(state_.tick, ticks);
  EXPECT_EQ(state_.safety.fault, Fault::kNone);
}

TEST_F(Loop, TorquesStayBelowThePeakAndTheWrenchKeepsItsDirection) {
  description_.motor_peak_torque_Nm = description_.motor_continuous_torque_Nm = 0.3;
  renew_device();
  tick();
  EXPECT_EQ(state_.safety.fault, Fault::kNone);
  EXPECT_LE(largest(device_.written), 0.3);
  EXPECT_GT(largest(device_.written), 0.29);
  EXPECT_LT(result_.row.wrench_scale, 1);
  for (int i = 0; i < 6; ++i) {
    EXPECT_NEAR(result_.row.wrench_delivered[i],
                result_.row.wrench_scale * result_.row.wrench_wanted[i], 1e-9);
  }
}

TEST_F(Loop, ARisingForceIsLimitedAndAReleaseIsNot) {
  mechanism_.torque_rise_max_Nm_per_s = 100;  // 0.1 Nm a tick
  renew_device();
  double last = 0;
  for (int i = 0; i < 3; ++i) {
    tick();
    EXPECT_NEAR(largest(device_.written) - last, 0.1, 1e-9);
    last = largest(device_.written);
  }
  allow_jumps(true);
  go_to(0.112);  // punctured
  tick();
  EXPECT_EQ(largest(device_.written), 0);
  EXPECT_TRUE(result_.contact.punctured_now);
}

}  // namespace
}  // namespace trocar::runtime
