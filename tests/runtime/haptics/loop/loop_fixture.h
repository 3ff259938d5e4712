// SPDX-License-Identifier: Apache-2.0
// The haptic loop with a scripted device, pushed into one sheet: for tests of single ticks.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "runtime/device/four_legs/four_legs.h"
#include "runtime/haptics/loop/haptic_loop.h"
#include "tests/support/exact_device.h"
#include "tests/support/sheet_fixture.h"
#include "tests/support/sheet_law_fixture.h"

namespace trocar::runtime::testing_support {

/// Returns scripted states and statuses, and stores the last command.
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
  std::uint8_t fault_byte() const noexcept override { return motors; }
  FaultDetail refused_contents() const noexcept override { return refused; }
  FaultDetail refused;
  std::uint8_t motors = 0;
  DeviceStatus on_read = DeviceStatus::kOk, on_write = DeviceStatus::kOk;
  int restored = 0;
  DeviceState next;
  DeviceCommand written;
};

inline double largest(const DeviceCommand& command) {
  double result = 0;
  for (const double tau : command.tau_motor_Nm)
    result = std::max(result, std::abs(tau));
  return result;
}

/// A sheet at 0.12 m and a device pushed 4 mm into it (20 N). The loop is running before each test.
class LoopFixture : public testing::Test {
 public:
  void SetUp() override {
    const Scene scene = test::descent_scene({0.12}, 0.2, 0.1, 0.015);
    sheets_ = std::move(*place_slices(scene, test::square_asset(1), "a"));
    current_ = {sheets_[0].get()};
    model_.tool = make_tool(scene.tool);
    law_ = test::hooke_law(model_);
    model_.rate_Hz = 1000;
    mechanism_.torque_rise_max_Nm_per_s = 1e6;
    allow_jumps(true);
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
    allow_jumps(false);
  }
  /// Whether the device may jump to another pose from one tick to the next.
  void allow_jumps(bool may) {
    mechanism_.encoder_rate_max_rad_per_s = may ? 1e3 : 60;
    model_.limits.speed_max_m_per_s = may ? 1e3 : 2;
    model_.limits.energy_limit_J = may ? 1e3 : 0.05;
    state_.speed.has_pose = false;
  }
  /// Starts again before the first tick, with the law's options as they are.
  void restart() {
    state_ = LoopState{};
    renew_device();
    law_ = SheetLaw{law_.model(), law_.coupling_options()};
  }
  /// The device has not been commanded any torques yet.
  void renew_device() {
    double ignored_t_s = 0;
    four_legs_.emplace(description_, device_, mechanism_);
    four_legs_->read(ignored_t_s);
    four_legs_->keep_reading();
  }
  /// The sheet gets this tissue.
  void use(const Tissue& tissue) {
    auto changed = std::make_unique<Sheet>(*current_[0]);
    changed->tissue = tissue;
    current_ = {changed.get()};
    sheets_.push_back(std::move(changed));
  }
  void use_tool(const Tool& tool) { model_.tool = law_.model().tool = tool; }
  void go_to(double z_m, double x_m = 0, double turn_rad = 0) {
    Pose pose;
    pose.p_m = {x_m, 0, z_m};
    pose.q = Eigen::AngleAxisd(turn_rad, Eigen::Vector3d::UnitY());
    const InverseResult inverse = inverse_kinematics(description_, pose);
    ASSERT_TRUE(inverse.status);
    device_.next.encoder_rad = encoder_angles(inverse.joints);
  }
  void tick(double gap_s = 1e-3) {
    device_.next.t_s += 1 / model_.rate_Hz + device_late_s_;
    TickInputs inputs;
    inputs.sheets = current_;
    inputs.prefetched = prefetched_;
    inputs.gap_s = gap_s;
    inputs.missed_in_row = missed_in_row_;
    inputs.outside = outside_;
    inputs.recover = recover_ ? RecoveryRequest::kByOperator : RecoveryRequest::kNone;
    four_legs_->change(description_, mechanism_);
    haptic_tick(model_, inputs, *four_legs_, law_, state_, result_);
  }
  void ticks(int count) {
    for (int i = 0; i < count; ++i)
      tick();
  }
  /// A fault that the caller finds in one tick.
  void tick_with(Fault outside) {
    outside_ = outside;
    tick();
    outside_ = Fault::kNone;
  }
  /// Ticks until a stop has faded, at most 100.
  void wait_for_zero_torques() {
    for (int i = 0; !result_.torques_are_zero && i < 100; ++i)
      tick();
  }
  /// The operator asks for recovery during one tick.
  void ask_to_recover() {
    recover_ = true;
    tick();
    recover_ = false;
  }
  /// Ticks until the loop is in this state, at most 1,000.
  void wait_for(SafetyState wanted) {
    for (int i = 0; state_.safety.state != wanted && i < 1000; ++i)
      tick();
    ASSERT_EQ(state_.safety.state, wanted);
  }
  /// The next tick must have this fault; it latches, and torques ramp down to zero.
  void expect_fault(Fault fault, double gap_s = 1e-3) {
    expect_found(fault, gap_s);
    expect_ramp();
  }
  void expect_found(Fault fault, double gap_s = 1e-3) {
    tick(gap_s);
    ASSERT_EQ(state_.safety.fault, fault) << to_string(state_.safety.fault);
    EXPECT_EQ(result_.found.fault, fault) << "with what was measured";
    EXPECT_EQ(result_.new_fault, fault);
    EXPECT_EQ(result_.row.fault, fault);
    EXPECT_EQ(result_.row.phase, ContactPhase::kFault);
  }
  void expect_ramp() {
    const Fault fault = state_.safety.fault;
    device_.on_read = device_.on_write = DeviceStatus::kOk;  // the fault is latched
    go_to(0.116);
    double last = largest(device_.written);
    EXPECT_LE(last, largest(good_));
    const bool in_writing = last == largest(good_);
    int ticks = 1;
    for (; !result_.torques_are_zero; ++ticks) {
      ASSERT_LT(ticks, 100);
      tick();
      EXPECT_EQ(state_.safety.fault, fault);
      const double left = std::max(0.0, 1 - static_cast<double>(state_.safety.ramp_ticks_done) / 4);
      for (int i = 0; i < kMotors; ++i) {
        ASSERT_NEAR(device_.written.tau_motor_Nm[i], left * four_legs_->torques_at_stop_Nm()[i],
                    1e-12);
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
  DeviceDescription description_ = test::exact_device();
  MechanismLimits mechanism_;
  LoopModel model_;
  SheetLaw law_{ContactModel{}};
  LoopState state_;
  TickResult result_;
  ScriptedDevice device_;
  std::optional<FourLegs> four_legs_{std::in_place, description_, device_};
  double device_late_s_ = 0;  ///< beyond a period, from one tick to the next on the device's clock
  DeviceCommand good_;
  PrefetchedStiffness prefetched_;
  int missed_in_row_ = 0;
  Fault outside_ = Fault::kNone;
  bool recover_ = false;
};

}  // namespace trocar::runtime::testing_support
