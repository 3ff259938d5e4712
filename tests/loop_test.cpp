// SPDX-License-Identifier: Apache-2.0
// The haptic loop against a scripted device: every fault by name, the safety laws, and how
// sessions end.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "runtime/loop/haptic_loop.h"
#include "runtime/loop/session.h"
#include "tests/sheet_fixture.h"

namespace trocar::runtime {
namespace {

/// Says what it is told to and keeps what it hears.
class ScriptedDevice final : public Device {
 public:
  DeviceStatus read(DeviceState& state) noexcept override {
    if (on_read == DeviceStatus::kOk) state = next;
    return on_read;
  }
  DeviceStatus write(const DeviceCommand& command) noexcept override {
    written = command;
    return on_write;
  }
  void restore() noexcept override { ++restored; }
  DeviceStatus on_read = DeviceStatus::kOk, on_write = DeviceStatus::kOk;
  int restored = 0;
  DeviceState next;
  DeviceCommand written;
};

double largest(const DeviceCommand& command) {
  double result = 0;
  for (const double tau : command.tau_motor_Nm)
    result = std::max(result, std::abs(tau));
  return result;
}

/// A sheet at 0.12 m, a device pushed 4 mm into it (20 N), one good tick done before each test.
class Loop : public testing::Test {
 protected:
  void SetUp() override {
    const Scene scene = test::descent_scene({0.12}, 0.2, 0.1, 0.015);
    sheets_ = std::move(*place_slices(scene, test::square_asset(1), "a"));
    current_ = {sheets_[0].get()};
    model_.device = default_device_description();
    model_.contact.tool = make_tool(scene.tool);
    model_.rate_Hz = 1000;
    model_.limits.torque_rise_max_Nm_per_s = 1e6;
    let_it_jump(true);
    go_to(0.125);
    tick();
    EXPECT_EQ(state_.safety.state, SafetyState::kReady);
    tick();
    EXPECT_EQ(state_.safety.state, SafetyState::kRunning);
    go_to(0.116);
    tick();
    ASSERT_EQ(state_.safety.fault, Fault::kNone);
    ASSERT_NEAR(result_.row.wrench_wanted[2], 20, 1e-9);
    ASSERT_GT(largest(device_.written), 0.1);
    good_ = device_.written;
    let_it_jump(false);
  }
  /// A test's device goes where it is told to from one tick to the next.
  void let_it_jump(bool may) {
    model_.limits.encoder_rate_max_rad_per_s = may ? 1e3 : 60;
    model_.limits.speed_max_m_per_s = may ? 1e3 : 2;
    state_.limits.has_pose = false;
  }
  void go_to(double z_m, double x_m = 0) {
    Pose pose;
    pose.p_m = {x_m, 0, z_m};
    const InverseResult inverse = inverse_kinematics(model_.device, pose);
    ASSERT_TRUE(inverse.status);
    device_.next.encoder_rad = encoder_angles(inverse.joints);
  }
  void tick(double gap_s = 1e-3) {
    TickInputs inputs;
    inputs.sheets = current_;
    inputs.gap_s = gap_s;
    inputs.missed_in_row = missed_in_row_;
    inputs.outside = outside_;
    inputs.recover = recover_;
    haptic_tick(model_, inputs, device_, state_, result_);
  }
  /// The next tick must have this fault, and laws 1 to 3 must hold from it on.
  void expect_fault(Fault fault, double gap_s = 1e-3) {
    tick(gap_s);
    ASSERT_EQ(state_.safety.fault, fault) << to_word(state_.safety.fault);
    EXPECT_EQ(result_.row.fault, fault);
    EXPECT_EQ(result_.row.phase, ContactPhase::kFault);
    device_.on_read = device_.on_write = DeviceStatus::kOk;  // all is well again: it latches
    go_to(0.116);
    double last = largest(device_.written);
    EXPECT_LE(last, largest(good_));
    const bool in_writing = last == largest(good_);
    int ticks = 1;
    for (; !result_.at_rest; ++ticks) {
      ASSERT_LT(ticks, 100);
      tick();
      EXPECT_EQ(state_.safety.fault, fault);
      const double left = std::max(0.0, 1 - static_cast<double>(state_.safety.ramp_ticks_done) / 4);
      for (int i = 0; i < kMotors; ++i) {
        ASSERT_NEAR(device_.written.tau_motor_Nm[i], left * state_.tau_at_stop_Nm[i], 1e-12);
      }
      EXPECT_LT(largest(device_.written), last);
      last = largest(device_.written);
    }
    EXPECT_EQ(ticks, in_writing ? 5 : 4) << "the ramp is 4 ms";
    EXPECT_EQ(largest(device_.written), 0);
    tick();
    EXPECT_EQ(largest(device_.written), 0);
    EXPECT_EQ(result_.row.fault, fault);
    EXPECT_EQ(result_.row.safety, SafetyState::kFault);
  }

  std::vector<std::unique_ptr<const Sheet>> sheets_;
  std::vector<const Sheet*> current_;
  LoopModel model_;
  LoopState state_;
  TickResult result_;
  ScriptedDevice device_;
  DeviceCommand good_;
  int missed_in_row_ = 0;
  Fault outside_ = Fault::kNone;
  bool recover_ = false;
};

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

TEST_F(Loop, WriteFailed) {
  device_.on_write = DeviceStatus::kNoData;
  expect_fault(Fault::kWriteFailed);
}

TEST_F(Loop, ALinkSilentForTenMillisecondsIsAFault) {
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

TEST_F(Loop, BeforeTheFirstDataThereIsNoTorque) {
  state_ = LoopState{};
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
  state_ = LoopState{};
  device_.next.encoder_rad[0] = INFINITY;
  tick();
  EXPECT_EQ(state_.safety.fault, Fault::kEncoderNotFinite);
  EXPECT_EQ(largest(device_.written), 0);
}

TEST_F(Loop, EncoderJump) {
  device_.next.encoder_rad[4] += 0.061;
  expect_fault(Fault::kEncoderJump);
}

TEST_F(Loop, EncoderRateIsJudgedOverTheTimeWithoutData) {
  device_.on_read = DeviceStatus::kNoData;
  tick();
  tick();
  device_.on_read = DeviceStatus::kOk;
  go_to(0.107);  // further than one tick may go, not further than three; 13 mm: gives way
  tick();
  EXPECT_EQ(state_.safety.fault, Fault::kNone) << to_word(state_.safety.fault);
}

TEST_F(Loop, JointLimit) {
  const double limit_rad = model_.device.joint_limit[0].max_rad;
  model_.limits.encoder_rate_max_rad_per_s = 1e6;
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
  model_.limits.inverse_condition_min = 0.999;  // no pose of this device is that good
  expect_fault(Fault::kSingularity);
}

TEST_F(Loop, TorqueNotFinite) {
  auto broken = std::make_unique<Sheet>(*current_[0]);
  broken->tissue.damping_N_s_per_m = 1e300;
  broken->tissue.threshold_N = INFINITY;
  current_ = {broken.get()};
  model_.contact.dt_s = 1e-300;
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

TEST_F(Loop, WhatTheCallerFound) {
  outside_ = Fault::kEmergencyStop;
  tick();
  outside_ = Fault::kNone;
  EXPECT_EQ(result_.row.outside_fault, Fault::kEmergencyStop);
  EXPECT_EQ(state_.safety.fault, Fault::kEmergencyStop);
}

TEST_F(Loop, Workspace) {
  model_.limits.workspace_max_m[0] = 0.01;
  let_it_jump(true);
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
  model_.limits.torque_max_Nm = 1.04 * largest(good_);
  go_to(0.1159);  // 20.5 N
  tick();
  ASSERT_EQ(state_.safety.fault, Fault::kNone);
  good_ = device_.written;
  go_to(0.1150);
  expect_fault(Fault::kTorqueLimit);
}

TEST_F(Loop, TorqueRate) {
  model_.limits.torque_rise_max_Nm_per_s = 1;
  state_.tau_motor_Nm.setZero();
  for (int i = 0; i < 20; ++i) {
    tick();
    ASSERT_EQ(state_.safety.fault, Fault::kNone) << i;
  }
  good_ = device_.written;
  expect_fault(Fault::kTorqueRate);
}

TEST_F(Loop, NearAnEndOfReach) {
  model_.limits.branch_distance_min_m = 0.2;  // no pose of this device is that far from one
  expect_fault(Fault::kSingularity);
}

// The wall softens along its own direction, down to what motors may give for ever, and is back once
// they have cooled; nobody is stopped.
TEST_F(Loop, HotMotorsGiveWaySmoothlyAndComeBack) {
  DeviceDescription& device = model_.device;
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
  let_it_jump(true);
  go_to(0.125);
  for (int i = 0; i < 2000; ++i)
    tick();
  go_to(0.116);
  tick();
  EXPECT_NEAR(result_.row.wrench_delivered[2], 20, 1e-9);
}

TEST_F(Loop, MotorOverloadWhenHotMotorsGiveTooLittleForTooLong) {
  model_.device.motor_continuous_torque_Nm = 0.3 * largest(good_);
  model_.device.motor_peak_torque_Nm = 1.5 * largest(good_);
  model_.device.motor_peak_time_s = 0.02;
  model_.limits.overload_time_max_s = 0.05;
  int ticks = 0;
  for (; state_.safety.fault == Fault::kNone; ++ticks) {
    ASSERT_LT(ticks, 1000);
    tick();
  }
  EXPECT_EQ(state_.safety.fault, Fault::kMotorOverload);
  EXPECT_GT(ticks, 50);
  EXPECT_LT(ticks, 150);
  for (int i = 0; i < 10; ++i)
    tick();
  recover_ = true;
  tick();
  recover_ = false;
  EXPECT_EQ(state_.safety.state, SafetyState::kRecovering);
  let_it_jump(true);
  go_to(0.121);
  tick();
  ASSERT_GT(result_.row.motor_heat_max, 0.6);
  for (int i = 0; result_.row.motor_heat_max > 0.5; ++i) {
    ASSERT_LT(i, 5000);
    ASSERT_EQ(state_.safety.quiet_ticks, 0U) << "hot: the quiet time has not begun";
    tick();
  }
  for (int i = 0; i < 300; ++i)
    tick();
  EXPECT_EQ(state_.safety.state, SafetyState::kRunning);
}

TEST_F(Loop, MotorOverloadWhenABudgetIsOverdrawn) {
  model_.device.motor_continuous_torque_Nm = 0.01;
  model_.device.motor_peak_time_s = 1e-9;  // shorter than a tick: nothing can give way in time
  expect_fault(Fault::kMotorOverload);
}

// Added to what is rendered, told apart from it, slowly from nothing on, and never beyond a limit.
TEST_F(Loop, WeightAndFrictionAreCompensatedIfAskedFor) {
  model_.compensation.gravity = true;
  model_.device.gravity_m_per_s2 = 9.81;
  double last_N = 0;
  for (int i = 1; i <= 400; ++i) {
    tick();
    ASSERT_EQ(state_.safety.fault, Fault::kNone);
    ASSERT_NEAR(result_.row.wrench_delivered[2], 20, 1e-9);
    const Wrench all = state_.G.transpose() * state_.tau_motor_Nm;
    ASSERT_NEAR(all[2] - 20, std::min(1.0, i / 250.0) * 0.35 * 9.81, 1e-6);
    ASSERT_GE(all[2], last_N);
    last_N = all[2];
  }
  const double limit_Nm = 0.9 * largest(device_.written);
  model_.device.motor_peak_torque_Nm = model_.device.motor_continuous_torque_Nm = limit_Nm;
  tick();
  EXPECT_LE(largest(device_.written), limit_Nm);
  EXPECT_LT(result_.row.wrench_scale, 1);
  for (int k = 0; k < 6; ++k) {
    EXPECT_NEAR(result_.row.wrench_delivered[k],
                result_.row.wrench_scale * result_.row.wrench_wanted[k], 1e-9);
  }
}

TEST_F(Loop, MotorOverloadWhenTheWeightAloneIsTooMuchForHotMotors) {
  model_.compensation.gravity = true;
  model_.device.gravity_m_per_s2 = 9.81;
  model_.device.plate_mass_kg = 10;
  model_.limits.timing.ramp_up_s = 0;
  model_.limits.overload_time_max_s = 1e9;
  tick();
  ASSERT_EQ(state_.safety.fault, Fault::kNone);
  model_.device.motor_continuous_torque_Nm = 0.5 * state_.beside_Nm.cwiseAbs().maxCoeff();
  model_.device.motor_peak_time_s = 0.02;
  int ticks = 0;
  for (; state_.safety.fault == Fault::kNone; ++ticks) {
    ASSERT_LT(ticks, 2000);
    tick();
  }
  EXPECT_GT(ticks, 10);
  EXPECT_EQ(state_.safety.fault, Fault::kMotorOverload);
}

TEST_F(Loop, CompensationMovesWithTheMotors) {
  model_.compensation.friction = true;
  model_.device.joint_coulomb_friction_Nm = 0.1;
  model_.limits.timing.ramp_up_s = 0;
  double z_m = 0.116;
  for (int i = 0; i < 60; ++i) {
    go_to(z_m += 0.1e-3);
    tick();
    ASSERT_EQ(state_.safety.fault, Fault::kNone);
  }
  const MotorVector rate = state_.G * state_.limits.twist_device;
  for (int i = 0; i < kMotors; ++i) {
    ASSERT_GT(std::abs(rate[i]), 0.1) << "fast enough for all of it";
    EXPECT_NEAR(state_.beside_Nm[i],
                0.8 * (std::copysign(0.1, rate[i]) +
                       model_.device.joint_viscous_friction_Nms_per_rad * rate[i]),
                1e-12);
  }
}

TEST_F(Loop, OnlyARequestLeavesTheFaultAndOnlyInFreeSpaceForcesComeBack) {
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
  let_it_jump(true);
  go_to(0.121);
  for (int i = 0; i < 200; ++i)
    tick();
  device_.on_read = DeviceStatus::kLinkLost;  // the time starts anew
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

TEST_F(Loop, OnlyAfterARequestIsALostDeviceAskedToRestoreItself) {
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
    EXPECT_EQ(device_.restored, 10) << "as long as it is away";
    let_it_jump(true);
    go_to(0.121);
    for (const DeviceStatus there : {DeviceStatus::kEmergencyStop, DeviceStatus::kOk}) {
      device_.on_read = there;
      for (int i = 0; i < 400; ++i)
        tick();
    }
    EXPECT_EQ(state_.safety.state, SafetyState::kRunning);
    EXPECT_EQ(device_.restored, 10);
  }
}

TEST_F(Loop, ARequestInAnyOtherStateDoesNothing) {
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
  SheetTrack& track = state_.contact.tracks[0];
  track.pending_count = kMaxPendingHoles;
  track.cuts_requested = kMaxPendingHoles;
  for (LatticeOutline& hole : track.pending) {  // far from the tool
    hole = outline_on_lattice(model_.contact.tool, Pose{{0.015, 0.015, 0.1}, {}},
                              current_[0]->transform, 0.12);
  }
  let_it_jump(true);
  go_to(0.112);
  expect_fault(Fault::kRemeshBacklog);
}

TEST_F(Loop, ToolTilt) {
  SceneTool shape;
  shape.tilt_deg = 45;
  model_.contact.tool = make_tool(shape);
  tick();
  ASSERT_EQ(state_.safety.fault, Fault::kNone);
  good_ = device_.written;
  Pose pose;
  pose.p_m = {0, 0, 0.116};
  pose.q = Eigen::AngleAxisd(0.01, Eigen::Vector3d::UnitY());
  const InverseResult inverse = inverse_kinematics(model_.device, pose);
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

TEST_F(Loop, TheEndOfTheDataIsNoTick) {
  device_.on_read = DeviceStatus::kEndOfData;
  const std::uint64_t ticks = state_.tick;
  tick();
  EXPECT_TRUE(result_.end_of_data);
  EXPECT_EQ(state_.tick, ticks);
  EXPECT_EQ(state_.safety.fault, Fault::kNone);
}

TEST_F(Loop, TorquesNeverExceedThePeakAndTheDirectionStays) {
  model_.device.motor_peak_torque_Nm = model_.device.motor_continuous_torque_Nm = 0.3;
  state_.tau_motor_Nm.setZero();
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

TEST(LimitRise, InsideNothingChangesOutsideItActsAlwaysWithinBounds) {
  std::mt19937_64 random(5);
  const auto any = [&] {
    MotorVector tau;
    for (int i = 0; i < kMotors; ++i) {
      tau[i] = (static_cast<double>(random() >> 11) * 0x1p-53 - 0.5) * 12;
    }
    return tau;
  };
  int acted = 0, inside = 0;
  for (int i = 0; i < 2000; ++i) {
    const MotorVector last = any() * (i % 5 == 0 ? 0 : 1), wanted = any();
    const double rise = 0.5 + static_cast<double>(i % 24);
    bool shortened = false;
    const MotorVector got = limit_rise(last, wanted, rise, shortened);
    const double step = (wanted - last).cwiseAbs().maxCoeff();
    const bool grows = wanted.cwiseAbs().maxCoeff() > last.cwiseAbs().maxCoeff();
    if (!grows || step <= rise) {
      EXPECT_EQ(got, wanted);
      EXPECT_FALSE(shortened);
      ++inside;
    } else {
      EXPECT_TRUE(shortened);
      EXPECT_NEAR((got - last).cwiseAbs().maxCoeff(), rise, 1e-12);
      // On the straight way from the one to the other: no motor is cut off by itself.
      const double share = rise / step;
      EXPECT_LT((got - ((1 - share) * last + share * wanted)).norm(), 1e-12);
      ++acted;
    }
  }
  EXPECT_GT(acted, 200);
  EXPECT_GT(inside, 200);
}

TEST_F(Loop, ARisingForceIsLimitedAndAReleaseIsNot) {
  model_.limits.torque_rise_max_Nm_per_s = 100;  // 0.1 Nm a tick
  state_.tau_motor_Nm.setZero();
  double last = 0;
  for (int i = 0; i < 3; ++i) {
    tick();
    EXPECT_NEAR(largest(device_.written) - last, 0.1, 1e-9);
    last = largest(device_.written);
  }
  let_it_jump(true);
  go_to(0.112);  // gives way
  tick();
  EXPECT_EQ(largest(device_.written), 0);
  EXPECT_TRUE(result_.contact.gave_way);
}

// --- session -------------------------------------------------------------------------------

TEST(Session, AStopEndsItWithTorquesAtZero) {
  const Scene scene = test::descent_scene({0.12}, 0.13, 0.1, 0.015);
  for (const Clock clock : {Clock::kVirtual, Clock::kReal}) {
    Remesher remesher(*place_slices(scene, test::square_asset(1), "a"));
    auto device = make_simulated_device(scene, default_device_description());
    ASSERT_TRUE(device);
    std::atomic<bool> stop{false};
    std::uint64_t ticks = 0;
    SessionOptions options;
    options.clock = clock;
    options.duration_s = 60;
    options.stop = &stop;
    options.limits.gap_max_s = 0;
    const auto report = run_session(
        scene, default_device_description(), remesher, *device,
        [&](double dt_s) {
          device->step(dt_s);
          if (++ticks == 50) stop = true;
        },
        options);
    ASSERT_TRUE(report);
    EXPECT_EQ(report->end, SessionEnd::kInterrupted);
    EXPECT_EQ(report->ticks, 50U);
    device->step(1e-3);
    EXPECT_EQ(device->truth().tau_motor_Nm.norm(), 0);
  }
}

TEST(Session, AFaultEndsItAfterTheRamp) {
  const Scene scene = test::descent_scene({0.12}, 0.13, 0.1, 0.015);
  Remesher remesher(*place_slices(scene, test::square_asset(1), "a"));
  ScriptedDevice device;
  device.on_read = DeviceStatus::kLinkLost;
  SessionOptions options;
  options.clock = Clock::kVirtual;
  const auto report = run_session(
      scene, default_device_description(), remesher, device, [](double) {}, options);
  ASSERT_TRUE(report);
  EXPECT_EQ(report->end, SessionEnd::kFault);
  EXPECT_EQ(report->fault, Fault::kLinkLost);
  EXPECT_EQ(report->ticks, 4U);
}

TEST(Session, AnUnwritableRecordingIsSaidBeforeAnythingRuns) {
  const Scene scene = test::descent_scene({0.12}, 0.13, 0.1, 0.015);
  Remesher remesher(*place_slices(scene, test::square_asset(1), "a"));
  ScriptedDevice device;
  SessionOptions options;
  options.record = "/no/such/folder/r.csv";
  const auto report = run_session(
      scene, default_device_description(), remesher, device, [](double) { FAIL(); }, options);
  ASSERT_FALSE(report);
  EXPECT_EQ(report.error().code, ExitCode::kUnwritable);
}

TEST(Session, CountsTicks) {
  EXPECT_EQ(tick_count(1, 1000), 1000U);
  EXPECT_EQ(tick_count(3.6, 500), 1800U);
  EXPECT_EQ(tick_count(0.1 + 0.2, 1000), 300U);
  EXPECT_EQ(tick_count(0.0005, 1000), 1U);
  EXPECT_EQ(tick_count(0.0015, 1000), 2U);
}

TEST(Session, TheRateOfARecordingIsThatOfItsTimes) {
  std::vector<RecordingRow> rows(1000);
  for (std::size_t k = 0; k < rows.size(); ++k)
    rows[k].t_s = static_cast<double>(k) / 500;
  ASSERT_TRUE(recorded_rate_Hz(rows, "r"));
  EXPECT_EQ(*recorded_rate_Hz(rows, "r"), 500);
  rows[500].t_s += 1e-4;
  EXPECT_FALSE(recorded_rate_Hz(rows, "r"));
  EXPECT_FALSE(recorded_rate_Hz(std::span(rows).first(1), "r"));
}

}  // namespace
}  // namespace trocar::runtime
