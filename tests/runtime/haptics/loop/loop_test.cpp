// SPDX-License-Identifier: Apache-2.0
// Single ticks of the haptic loop against a scripted device: every fault by name and measured quantity,
// the ramp, recovery, the bounds of the torques, warm motors and compensation.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>
#include <numbers>
#include <string>
#include <vector>

#include "runtime/haptics/loop/haptic_loop.h"
#include "tests/runtime/haptics/loop/loop_fixture.h"
#include "tests/support/sheet_fixture.h"

namespace trocar::runtime {
namespace {

using testing_support::largest;

using Loop = testing_support::LoopFixture;

constexpr double kAny = HUGE_VAL, kAbove = 1e200, kBelow = -1e200;  // the limit

/// What the tick says of its fault: which sensor or quantity (none: not looked at; with '_' at its end: what it begins
/// with), its value, its limit.
struct Said {
  const char* quantity = nullptr;
  double value = kAny, limit = kAny, within = 1e-9;
};

using Prepare = std::function<void(Loop& l)>;

struct Found {
  const char* name;
  Fault fault;
  Prepare prepare;
  Said said;
  double gap_s = 1e-3;
};

void PrintTo(const Found& row, std::ostream* out) {
  *out << row.name;
}

void expect_no_fault(Loop& l, int ticks = 1) {
  for (int i = 0; i < ticks; ++i) {
    l.tick();
    ASSERT_EQ(l.state_.safety.fault, Fault::kNone) << i;
  }
  l.good_ = l.device_.written;
}

Prepare status(DeviceStatus on_read, DeviceStatus on_write, const FaultDetail& refused = {}) {
  return [=](Loop& l) {
    l.device_.on_read = on_read;
    l.device_.on_write = on_write;
    l.device_.refused = refused;
    if (on_read == DeviceStatus::kMotorFault)
      l.device_.motors = 0b1000'0100;  // theta1 of leg 2, theta4 of leg 4
    if (on_read == DeviceStatus::kNoData) expect_no_fault(l, 9);
  };
}
Prepare encoder(std::size_t i, double to_rad) {
  return [=](Loop& l) {
    l.mechanism_.encoder_rate_max_rad_per_s = 1e6;
    l.device_.next.encoder_rad[i] = to_rad;
  };
}
Prepare encoder_by(std::size_t i, double rad) {
  return [=](Loop& l) { l.device_.next.encoder_rad[i] += rad; };
}
Prepare mechanism(double MechanismLimits::*limit, double value) {
  return [=](Loop& l) { l.mechanism_.*limit = value; };
}
void go_beyond_the_workspace(Loop& l) {
  l.model_.limits.workspace_max_m[0] = 0.01;
  l.allow_jumps(true);
  l.go_to(0.116, 0.0099);
  expect_no_fault(l);
  l.go_to(0.116, 0.0101);
}
void miss_almost(Loop& l) {
  l.tick(0.0999);
  ASSERT_EQ(l.state_.safety.fault, Fault::kNone);
}
void miss_deadlines(Loop& l) {
  l.missed_in_row_ = 2;
  expect_no_fault(l);
  l.missed_in_row_ = 3;
}
void press_too_hard(Loop& l) {
  l.mechanism_.torque_max_Nm = 1.04 * largest(l.good_);
  l.go_to(0.1159);  // 20.5 N
  expect_no_fault(l);
  l.go_to(0.1150);
}
void let_torques_rise_slowly(Loop& l) {
  l.mechanism_.torque_rise_max_Nm_per_s = 1;
  l.renew_device();
  expect_no_fault(l, 20);
}
void break_the_tissue(Loop& l) {
  Tissue broken = l.current_[0]->tissue;
  broken.damping_N_s_per_m = broken.threshold_N = INFINITY;
  l.use(broken);
  l.go_to(0.1158);
}
void fill_the_list_of_holes(Loop& l) {
  SheetTrack& track = l.law_.contact().tracks[0];
  track.pending_count = kMaxPendingHoles;
  track.cuts_requested = kMaxPendingHoles;
  for (LatticeOutline& hole : track.pending) {  // far from the tool
    Pose pose;
    pose.p_m = {0.015, 0.015, 0.1};
    hole = outline_on_lattice(l.model_.tool, pose, l.current_[0]->transform, 0.12);
  }
  l.allow_jumps(true);
  l.go_to(0.112);
}
void tilt_the_tool(Loop& l) {
  SceneTool shape;
  shape.tilt_deg = 45;
  l.use_tool(make_tool(shape));
  expect_no_fault(l);
  l.go_to(0.116, 0, 0.01);
}
// By 0.1 mm at a limit of zero, or by 0.5 mm out of 20 N; the jump into the sheet took nothing from the hand.
void move_against(double SafetyLimits::*limit, double value, double z_m, Loop& l) {
  l.tick();
  l.model_.limits.*limit = value;
  l.go_to(z_m);
}

const JointLimit kFirst = default_device_description().joint_limit[0];
const double kPoseMax_m = MechanismLimits{}.pose_residual_max_m,
             kTheta4Max_rad = MechanismLimits{}.theta4_residual_max_rad;
constexpr double kTiltMax_rad = std::numbers::pi / 4;

// One refused state is no fault; the link drops it, so that no data comes. Encoders 0, 4, ... are theta1; the fit of the pose
// does not use theta4. No pose of this device is as good, or as far from a branch, as the last two limits of a singularity say.
Found row(const char* name, Fault fault, const Prepare& prepare, const Said& said = {},
          double gap_s = 1e-3) {
  return {name, fault, prepare, said, gap_s};
}
std::vector<Found> found_faults() {
  using M = MechanismLimits;
  using enum DeviceStatus;
  return {
      row("LinkLost", Fault::kLinkLost, status(kLinkLost, kOk)),
      row("LinkLostInWriting", Fault::kLinkLost, status(kOk, kLinkLost)),
      row("WriteFailed", Fault::kWriteFailed, status(kOk, kNoData), {"", 0, 0}),
      row("MotorOfTheDrive", Fault::kMotorFault, status(kMotorFault, kOk), {"motor_2_1"}),
      row("NoData", Fault::kNoData, status(kNoData, kOk), {"time_without_data_s", 0.01, 0.01}),
      row("RefusedField", Fault::kRefusedState,
          status(kNoData, kOk, {Fault::kRefusedState, FaultQuantity::kEncoderAngle, 6, NAN, 1000}),
          {"th_2_3_rad", NAN}),
      row("RefusedFieldOnALostLink", Fault::kRefusedState,
          status(kLinkLost, kOk, {Fault::kRefusedState, FaultQuantity::kStateMode, -1, 9, 4}),
          {"state_mode", 9, 4}),
      row("NotFinite", Fault::kEncoderNotFinite, encoder(7, NAN), {"th_2_4_rad", NAN}),
      row("NotFiniteToo", Fault::kEncoderNotFinite, encoder(13, NAN), {"th_4_2_rad", NAN}),
      row("Jump", Fault::kEncoderJump, encoder_by(4, 0.061), {"th_2_1_step_rad", 0.061, 0.06}),
      row("JumpBack", Fault::kEncoderJump, encoder_by(6, -0.3), {"th_2_3_step_rad", 0.3, 0.06}),
      row("JointAbove", Fault::kJointLimit, encoder(0, kFirst.max_rad + 1e-6),
          {"th_1_1_rad", kFirst.max_rad + 1e-6, kFirst.max_rad}),
      row("JointBelow", Fault::kJointLimit, encoder(8, kFirst.min_rad - 0.01),
          {"th_3_1_rad", kFirst.min_rad - 0.01, kFirst.min_rad}),
      row("UpperChains", Fault::kPoseResidual, encoder_by(1, 0.05),
          {"pose_residual_m", kAbove, kPoseMax_m}),
      row("LowerMotor", Fault::kPoseResidual, encoder_by(3, 0.05),
          {"th_1_4_residual_rad", 0.05, kTheta4Max_rad, 1e-6}),
      row("LowerMotorToo", Fault::kPoseResidual, encoder_by(11, 0.05),
          {"th_3_4_residual_rad", 0.05, kTheta4Max_rad, 1e-6}),
      row("Condition", Fault::kSingularity, mechanism(&M::inverse_condition_min, 0.999),
          {"inverse_condition", kBelow, 0.999}),
      row("Branch", Fault::kSingularity, mechanism(&M::branch_distance_min_m, 0.2),
          {"branch_distance_", kBelow, 0.2}),
      row("TorqueNotFinite", Fault::kTorqueNotFinite, break_the_tissue),
      row("Deadline", Fault::kDeadlineMissed, miss_almost, {"tick_gap_s", 0.1001, 0.1}, 0.1001),
      row("ThreeDeadlines", Fault::kDeadlineMissed, miss_deadlines,
          {"missed_deadlines_in_row", 3, 2}),
      row("Workspace", Fault::kWorkspace, go_beyond_the_workspace, {"x_m", 0.0101, 0.01}),
      row("TorqueLimit", Fault::kTorqueLimit, press_too_hard, {"tau_", kAbove}),
      row("TorqueRate", Fault::kTorqueRate, let_torques_rise_slowly),
      row("RemeshBacklog", Fault::kRemeshBacklog, fill_the_list_of_holes),
      row("ToolTilt", Fault::kToolTilt, tilt_the_tool,
          {"tool_tilt_rad", kTiltMax_rad + 0.01, kTiltMax_rad, 1e-6}),
      row("Speed", Fault::kSpeed,
          std::bind_front(move_against, &SafetyLimits::speed_max_m_per_s, 0, 0.1159),
          {"plate_speed_m_per_s", kAbove, 0}),
      row("Energy", Fault::kEnergyLimit,
          std::bind_front(move_against, &SafetyLimits::energy_limit_J, 1e-5, 0.1165),
          {"energy_released_J", 0.01, 1e-5}),
  };
}

class LoopFound : public Loop, public testing::WithParamInterface<Found> {};
INSTANTIATE_TEST_SUITE_P(Loop, LoopFound, testing::ValuesIn(found_faults()),
                         [](const auto& row) { return std::string(row.param.name); });

TEST_P(LoopFound, IsNamedWithItsQuantityAndTorquesRampDown) {
  const Said& said = GetParam().said;
  GetParam().prepare(*this);
  expect_found(GetParam().fault, GetParam().gap_s);
  const FaultDetail& found = result_.found;
  if (said.quantity != nullptr) {
    const std::string is = quantity_name(found), wanted = said.quantity;
    EXPECT_EQ(wanted.ends_with('_') ? is.substr(0, wanted.size()) : is, wanted);
    EXPECT_TRUE(!wanted.ends_with('_') || found.index >= 0);
  }
  if (std::isnan(said.value)) {
    EXPECT_TRUE(std::isnan(found.value)) << measured(found);
  } else if (said.value == kAbove) {
    EXPECT_GT(found.value, found.limit) << measured(found);
  } else if (said.value == kBelow) {
    EXPECT_LT(found.value, found.limit) << measured(found);
  } else if (said.value != kAny) {
    EXPECT_NEAR(found.value, said.value, said.within) << measured(found);
  }
  if (said.limit != kAny) {
    EXPECT_NEAR(found.limit, said.limit, 1e-12);
  }
  if (found.quantity == FaultQuantity::kStateMode) {
    EXPECT_EQ(measured(found), "mode 9, limit 4");
  }
  if (GetParam().fault == Fault::kTorqueLimit) {
    EXPECT_EQ(found.limit, mechanism_.torque_max_Nm);
  }
  EXPECT_EQ(result_.row.outside_fault,
            GetParam().fault == Fault::kDeadlineMissed ? Fault::kDeadlineMissed : Fault::kNone);
  if (GetParam().fault == Fault::kEnergyLimit) {
    EXPECT_TRUE(result_.torques_are_zero);
  } else {
    expect_ramp();
  }
}

TEST_F(Loop, EndOfDataInWritingIsALostLinkAndCanBeRecorded) {
  device_.on_write = DeviceStatus::kEndOfData;
  expect_fault(Fault::kLinkLost);
  device_.on_write = DeviceStatus::kEndOfData;
  tick();
  EXPECT_EQ(result_.row.device_write, DeviceStatus::kLinkLost);
  EXPECT_STREQ(to_string(result_.row.device_write), "link_lost");
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

TEST_F(Loop, EncoderNotFiniteInTheFirstTick) {
  restart();
  device_.next.encoder_rad[0] = INFINITY;
  tick();
  EXPECT_EQ(state_.safety.fault, Fault::kEncoderNotFinite);
  EXPECT_EQ(largest(device_.written), 0);
}

TEST_F(Loop, RecoveryNeedsARequestAndATimeInFreeSpace) {
  device_.next.encoder_rad[4] += 0.061;
  expect_fault(Fault::kEncoderJump);  // the tool stands in the sheet
  ticks(1000);
  EXPECT_EQ(state_.safety.state, SafetyState::kFault);
  ask_to_recover();
  EXPECT_EQ(result_.row.recovery_asked, 1);
  for (int i = 0; i < 1000; ++i) {
    tick();
    ASSERT_EQ(state_.safety.state, SafetyState::kRecovering) << "in the sheet";
    ASSERT_EQ(largest(device_.written), 0);
    ASSERT_EQ(result_.row.fault, Fault::kEncoderJump);
  }
  allow_jumps(true);
  go_to(0.121);
  ticks(200);
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
  wait_for(SafetyState::kReady);
  law_.model().uses_prefetched_stiffness = true;
  prefetched_.stiffness_N_per_m = INFINITY;
  tick();
  EXPECT_EQ(state_.safety.fault, Fault::kTorqueNotFinite);
  EXPECT_EQ(largest(device_.written), 0) << "the ramp starts from the last command written";
}

TEST_F(Loop, MotionDuringAStopCausesNoFrictionAfterIt) {
  Tissue tissue = current_[0]->tissue;
  tissue.shaft.dry_friction_N = 2;
  tissue.shaft.viscous_friction_N_s_per_m = 30;
  use(tissue);
  allow_jumps(true);
  go_to(0.112);
  tick();
  ASSERT_TRUE(result_.contact.punctured_now);
  go_to(0.1118);
  tick();
  ASSERT_GT(result_.contact.wrench_device.z(), 1) << "friction";
  tick_with(Fault::kEmergencyStop);
  wait_for_zero_torques();
  recover_ = true;
  go_to(0.108);
  wait_for(SafetyState::kRunning);
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
    ticks(100);
    EXPECT_EQ(state_.safety.state, SafetyState::kFault);
    EXPECT_EQ(device_.restored, 0);
    ask_to_recover();
    ticks(9);
    EXPECT_EQ(state_.safety.state, SafetyState::kRecovering);
    EXPECT_EQ(device_.restored, 10) << "in every tick in which it is lost";
    allow_jumps(true);
    go_to(0.121);
    for (const DeviceStatus back : {DeviceStatus::kEmergencyStop, DeviceStatus::kOk}) {
      device_.on_read = back;
      recover_ = back == DeviceStatus::kOk;  // a stop that was pressed meanwhile is a new fault
      ticks(400);
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
  ticks(20);
  EXPECT_EQ(device_.restored, 0);
  ask_to_recover();
  EXPECT_TRUE(result_.recovery_is_refused);
  EXPECT_EQ(result_.found.fault, Fault::kLinkLost);
  EXPECT_EQ(device_.restored, 1);
  device_.on_read = DeviceStatus::kOk;
  ticks(400);
  EXPECT_EQ(state_.safety.state, SafetyState::kFault) << "the request is not kept";
  EXPECT_EQ(state_.safety.fault, Fault::kEmergencyStop);
  recover_ = true;
  tick();
  EXPECT_EQ(state_.safety.state, SafetyState::kRecovering);
}

TEST_F(Loop, AStopDuringAnotherFaultIsReported) {
  for (const bool by_write : {false, true}) {
    device_.next.encoder_rad[7] = NAN;
    ticks(6);
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

TEST_F(Loop, TheEndOfTheDataDoesNotCountAsATick) {
  device_.on_read = DeviceStatus::kEndOfData;
  const std::uint64_t ticks = state_.tick;
  tick();
  EXPECT_TRUE(result_.end_of_data);
  EXPECT_EQ(state_.tick, ticks);
  EXPECT_EQ(state_.safety.fault, Fault::kNone);
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

TEST_F(Loop, WhatPreventsARecovery) {
  device_.next.encoder_rad[6] -= 0.3;
  ticks(6);
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

// Torques of the loop with warm motors, and with compensation of friction and weight.

class LoopMotors : public testing_support::LoopFixture {
 protected:
  /// Presses with hot motors until kMotorOverload is raised, and waits until torques are zero.
  /// Returns the number of ticks to the fault.
  int overload() {
    description_.motor_continuous_torque_Nm = 0.3 * largest(good_);
    description_.motor_peak_torque_Nm = 1.5 * largest(good_);
    description_.motor_peak_time_s = 0.02;
    mechanism_.overload_time_max_s = 0.05;
    int to_fault = 0;
    for (; state_.safety.fault == Fault::kNone && to_fault < 1000; ++to_fault)
      tick();
    EXPECT_EQ(state_.safety.fault, Fault::kMotorOverload);
    ticks(10);
    return to_fault;
  }
  /// Requests recovery in free space. It must wait until the motors have cooled.
  void expect_rest_before_running() {
    ask_to_recover();
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
    ticks(300);
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
  ticks(2000);
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
  tick_with(Fault::kEmergencyStop);
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
    const Wrench all =
        four_legs_->motor_jacobian().transpose() * MotorVector(result_.row.tau_Nm.data());
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
