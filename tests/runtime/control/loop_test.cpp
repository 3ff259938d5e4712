// SPDX-License-Identifier: Apache-2.0
// The haptic loop against a scripted device: every fault by name, the safety laws, and how
// sessions end.
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <random>
#include <thread>

#include "runtime/control/haptic_loop.h"
#include "runtime/session/session.h"
#include "tests/runtime/control/loop_fixture.h"
#include "tests/support/sheet_fixture.h"

namespace trocar::runtime {
namespace {

using testing_support::largest;
using testing_support::ScriptedDevice;
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

TEST_F(Loop, MotionDuringAStopIsNoFrictionAfterIt) {
  auto sheet = std::make_unique<Sheet>(*sheets_[0]);
  sheet->tissue.shaft.dry_friction_N = 2;
  sheet->tissue.shaft.viscous_friction_N_s_per_m = 30;
  current_ = {sheet.get()};
  let_it_jump(true);
  go_to(0.112);
  tick();
  ASSERT_TRUE(result_.contact.gave_way);
  go_to(0.1118);
  tick();
  ASSERT_GT(result_.contact.wrench_device.z(), 1) << "friction";
  outside_ = Fault::kEmergencyStop;
  tick();
  outside_ = Fault::kNone;
  for (int i = 0; !result_.at_rest && i < 100; ++i)
    tick();
  recover_ = true;
  go_to(0.108);
  for (int i = 0; state_.safety.state != SafetyState::kRunning && i < 1000; ++i)
    tick();
  ASSERT_EQ(state_.safety.state, SafetyState::kRunning);
  EXPECT_EQ(result_.contact.wrench_device.z(), 0) << "3.8 mm, most of them before this tick";
  go_to(0.1078);
  tick();
  EXPECT_GT(result_.contact.wrench_device.z(), 1) << "in its hole as before";
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
    Pose pose;
    pose.p_m = {0.015, 0.015, 0.1};
    hole = outline_on_lattice(model_.contact.tool, pose, current_[0]->transform, 0.12);
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

/// A simulated device; says when torques are on its motors.
class WatchedDevice final : public Device {
 public:
  explicit WatchedDevice(SimulatedDevice& device) : device_(device) {}
  DeviceStatus read(DeviceState& state) noexcept override { return device_.read(state); }
  DeviceStatus write(const DeviceCommand& command) noexcept override {
    const DeviceStatus status = device_.write(command);
    is_loaded = largest(command) > 0;
    return status;
  }
  std::atomic<bool> is_loaded{false};

 private:
  SimulatedDevice& device_;
};

TEST(Session, MotorsDoNotWaitForOtherThreadsAtItsEnd) {
  const Scene scene = test::descent_scene({0.12}, 0.121, 0.1, 0.05);
  Remesher remesher(*place_slices(scene, test::square_asset(1), "a"));
  auto simulated = make_simulated_device(scene, default_device_description());
  ASSERT_TRUE(simulated);
  WatchedDevice device(*simulated);
  std::atomic<bool> stop{false}, loaded{false}, released{false};
  SessionOptions options;
  options.duration_s = 2;
  options.stop = &stop;
  options.limits.gap_max_s = 0;
  // A display that is busy when the session ends, until torques are gone or it has had enough.
  options.on_frame = [&](const RecordingRow&, const auto&) {
    const auto start = std::chrono::steady_clock::now();
    while (!released && std::chrono::steady_clock::now() - start < std::chrono::seconds(5)) {
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
      released = stop && !device.is_loaded;
    }
  };
  options.frame_rate_Hz = 1000;
  const auto report = run_session(
      scene, default_device_description(), remesher, device,
      [&](double dt_s) {
        simulated->step(dt_s);
        if (!device.is_loaded || simulated->truth().tau_motor_Nm.norm() < 0.5) return;
        loaded = true;
        stop = true;
      },
      options);
  ASSERT_TRUE(report);
  ASSERT_TRUE(loaded) << "the tool was never pressed into the sheet";
  EXPECT_EQ(report->end, SessionEnd::kInterrupted);
  EXPECT_TRUE(released) << "torques stayed on while the display was waited for";
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

TEST(Session, TheRateOfARecordingIsItsOwnToTheLastBit) {
  for (const double rate_Hz : {209.3, 211.8, 212.3, 1000.0000001, 999.9999999, 333.33333333333331,
                               100.0, 123.456789012345, 8000.0, 997.3}) {
    for (const std::size_t size : {std::size_t{2}, std::size_t{3}, std::size_t{6280}}) {
      std::vector<RecordingRow> rows(size);
      for (std::size_t k = 0; k < size; ++k)
        rows[k].t_s = static_cast<double>(k) / rate_Hz;
      const Result<double> found = recorded_rate_Hz(rows, "r");
      ASSERT_TRUE(found) << found.error().message;
      EXPECT_EQ(size > 3 ? *found : rate_Hz, rate_Hz);
      for (std::size_t k = 0; k < size; ++k)
        ASSERT_EQ(static_cast<double>(k) / *found, rows[k].t_s) << rate_Hz << ", row " << k;
    }
  }
  std::vector<RecordingRow> rows(1000);  // times with four digits are none of a rate's
  for (std::size_t k = 0; k < rows.size(); ++k)
    rows[k].t_s = std::round(1e4 * static_cast<double>(k) / 209.3) / 1e4;
  const Result<double> none = recorded_rate_Hz(rows, "r");
  ASSERT_FALSE(none);
  EXPECT_EQ(none.error().code, ExitCode::kRefused);
}

}  // namespace
}  // namespace trocar::runtime
