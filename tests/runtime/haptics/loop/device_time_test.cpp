// SPDX-License-Identifier: Apache-2.0
// Velocities, the largest step of an encoder and the heat of the motors by the times of the device's
// states, times that cannot be true, and ticks without data.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <numbers>
#include <random>
#include <vector>

#include "runtime/haptics/contact_design.h"
#include "runtime/session/open_device.h"
#include "tests/runtime/haptics/loop/loop_fixture.h"
#include "tests/support/uniform.h"

namespace trocar::runtime {
namespace {

using testing_support::largest;

// Velocities, the largest step of an encoder and the heat of the motors by the times of the
// device's states, and what the loop does with times that cannot be true.

class DeviceTime : public testing_support::LoopFixture {
 protected:
  void SetUp() override {
    LoopFixture::SetUp();
    Tissue tissue = sheets_[0]->tissue;
    tissue.damping_N_s_per_m = 40;
    tissue.shaft.viscous_friction_N_s_per_m = 30;
    use(tissue);
    tick();
  }
  /// A tick whose state is `interval_s` after the last one, and that starts `gap_s` after the last.
  void tick_after(double interval_s, double gap_s = 1e-3) {
    device_late_s_ = interval_s - 1 / model_.rate_Hz;
    tick(gap_s);
    device_late_s_ = 0;
  }
  /// One with the state as it is, at this time.
  void tick_at(double t_s) {
    device_.next.t_s = t_s - 1 / model_.rate_Hz;
    tick();
  }
  struct Range {
    double low = std::numeric_limits<double>::infinity(), high = -low;
  };
  /// The range of `value` in a descent at 50 mm/s with coarse encoders, from its 30th tick on.
  Range descend_by_counts(const std::function<double()>& value) {
    description_.encoder_counts_per_revolution = 20'000;
    const FourLegsSpecification specification(description_);
    model_.estimator =
        design_contact(specification, plate_axes(specification, state_.T_device_plate), {1e-3, 0},
                       {.translation_N_per_m = 5000, .damping_N_s_per_m = 40})
            ->estimator;
    const double count_rad = 2 * std::numbers::pi / 20'000;
    double z_m = (state_.T_device_plate * model_.tool.tip_plate_m).z();
    Range range;
    for (int i = 0; i < 60; ++i) {
      go_to(z_m -= 0.05e-3);
      for (double& angle : device_.next.encoder_rad)
        angle = std::round(angle / count_rad) * count_rad;
      tick();
      EXPECT_EQ(state_.safety.fault, Fault::kNone) << to_string(state_.safety.fault);
      if (i < 30) continue;
      range.low = std::min(range.low, value());
      range.high = std::max(range.high, value());
    }
    return range;
  }
  double felt_N() const { return result_.row.wrench_wanted[2]; }
  /// A replay of these rows gives the same torques, faults and times.
  void expect_replay(const std::vector<RecordingRow>& rows) {
    model_.limits.state_gap_max_s = std::numeric_limits<double>::infinity();
    ReplayDevice recorded(rows);
    FourLegs replay(description_, recorded, mechanism_);
    LoopState again;
    SheetLaw law = test::hooke_law(model_);
    TickResult result;
    for (const RecordingRow& row : rows) {
      TickInputs inputs;
      inputs.sheets = current_;
      inputs.outside = row.outside_fault;
      haptic_tick(model_, inputs, replay, law, again, result);
      ASSERT_EQ(result.row.tau_Nm, row.tau_Nm) << row.t_s;
      ASSERT_EQ(result.row.fault, row.fault);
      ASSERT_EQ(result.row.state_t_s, row.state_t_s);
    }
  }
};

TEST_F(DeviceTime, ShaftFrictionIsTakenOverTheTimeBetweenStates) {
  allow_jumps(true);
  double z_m = 0.112;
  go_to(z_m);
  tick();
  ASSERT_TRUE(result_.contact.punctured_now);
  for (const double interval_s : {1e-3, 3e-3, 7e-3, 2e-3, 1e-3}) {
    go_to(z_m -= 0.05 * interval_s);
    tick_after(interval_s);
    EXPECT_NEAR(felt_N(), 1.5, 1e-6) << interval_s;
  }
}

TEST_F(DeviceTime, ACouplingTakesItToo) {
  law_.coupling_options().on = true;
  double z_m = 0.1165;
  for (int i = 0; i < 60; ++i) {  // to its equilibrium
    go_to(z_m -= 0.05e-3);
    tick();
  }
  const double on_time_N = felt_N() - 5000 * (0.12 - z_m) * 10 / 15;
  for (const double interval_s : {3e-3, 5e-3, 2e-3, 1e-3}) {
    go_to(z_m -= 0.05 * interval_s);
    tick_after(interval_s);
    EXPECT_NEAR(felt_N() - 5000 * (0.12 - z_m) * 10 / 15, on_time_N, 0.02) << interval_s;
  }
}

TEST_F(DeviceTime, CoarseEncodersGiveASteadyFrictionOfTheShaft) {
  allow_jumps(true);
  go_to(0.112);
  tick();
  ASSERT_TRUE(result_.contact.punctured_now);
  const Range friction_N = descend_by_counts([&] { return felt_N(); });
  EXPECT_GT(friction_N.low, 0.9 * 1.5);
  EXPECT_LT(friction_N.high, 1.1 * 1.5);
}

// The proxy moves by two thirds of what the tool moves, a spring of 10 kN/m before one of 5 kN/m.
TEST_F(DeviceTime, CoarseEncodersGiveASteadyForceThroughACoupling) {
  law_.coupling_options().on = true;
  const Range damping_N = descend_by_counts(
      [&] { return result_.contact.damping_N_s_per_m * result_.contact.rate_m_per_s; });
  EXPECT_GT(damping_N.low, 0.8 * 2 * 2 / 3);
  EXPECT_LT(damping_N.high, 1.2 * 2 * 2 / 3);
}

TEST_F(DeviceTime, TheLargestStepOfAnEncoderIsThatOfTheTimeBetweenStates) {
  model_.limits.speed_max_m_per_s = 1e3;
  device_.next.encoder_rad[4] += 0.02;  // 80 rad/s in a quarter of a tick
  tick_after(2.5e-4);
  EXPECT_EQ(state_.safety.fault, Fault::kEncoderJump);
}

TEST_F(DeviceTime, ALateStateMayHaveMovedFurther) {
  allow_jumps(false);
  model_.limits.speed_max_m_per_s = 3;
  go_to(0.1065);  // 2.4 m/s; too far for one tick
  tick_after(4e-3);
  EXPECT_EQ(state_.safety.fault, Fault::kNone) << to_string(state_.safety.fault);
}

// The device's clock cannot excuse every step: no more than in the time without data that is
// tolerated.
TEST_F(DeviceTime, ALongIntervalDoesNotExcuseEveryStep) {
  device_.next.encoder_rad[4] += 0.61;
  tick_after(0.09);
  EXPECT_EQ(state_.safety.fault, Fault::kEncoderJump);
}

TEST_F(DeviceTime, AStateThatIsNotNewerIsNoNewState) {
  const double t_s = device_.next.t_s, nan = std::numeric_limits<double>::quiet_NaN();
  const double infinity = std::numeric_limits<double>::infinity();
  const double before_N = felt_N();
  for (const double wrong_s : {nan, infinity, -infinity, t_s, t_s - 1e-9, t_s - 5, -1e300}) {
    go_to(0.115);  // it is not used
    tick_at(wrong_s);
    ASSERT_EQ(state_.safety.fault, Fault::kNone) << wrong_s;
    EXPECT_EQ(result_.row.device_read, DeviceStatus::kNoData) << wrong_s;
    EXPECT_EQ(result_.row.state_t_s, t_s) << wrong_s;
    EXPECT_EQ(felt_N(), before_N) << wrong_s;
  }
  go_to(0.1158);
  tick_at(t_s + 8e-3);
  EXPECT_EQ(result_.row.device_read, DeviceStatus::kOk);
  // At rest before, so that the velocity at its end may be twice the mean.
  EXPECT_GT(felt_N(), 21 + 40 * 0.2e-3 / 8e-3 - 1e-6);
  EXPECT_LT(felt_N(), 21 + 40 * 0.4e-3 / 8e-3);
}

// Velocities are quotients over the time between two states. A state that comes less than a fifth of
// a tick after the last one is left out, and the next one shows the whole motion.
TEST_F(DeviceTime, NoVelocityIsTakenOverLessThanAFifthOfATick) {
  double z_m = 0.1168, off_s = 0;
  go_to(z_m);
  tick();
  int left_out = 0;
  for (int k = 0; k < 200; ++k) {
    // The true motion is steady, 10 mm/s, for which 40 N s/m give 0.4 N. Only the stamps are off.
    const double next_s = k % 2 == 0 ? 0.49e-3 : -0.49e-3;
    go_to(z_m -= 1e-5);
    tick_after(1e-3 + next_s - off_s);
    off_s = next_s;
    ASSERT_EQ(state_.safety.fault, Fault::kNone) << k;
    left_out += state_.pose_interval_s == 0;
    ASSERT_TRUE(state_.pose_interval_s == 0 || state_.pose_interval_s >= kLeastInterval * 1e-3)
        << k;
    if (k <= 12) continue;  // it began at rest
    ASSERT_NEAR(result_.contact.damping_N_s_per_m * result_.contact.rate_m_per_s, 0.4, 0.01) << k;
  }
  EXPECT_GT(left_out, 90);
}

TEST_F(DeviceTime, RandomStampsNeitherEndTheSessionNorTurnAVelocityRound) {
  std::mt19937_64 random(5);
  double z_m = 0.1168, off_s = 0;
  go_to(z_m);
  tick();
  for (int k = 0; k < 250; ++k) {
    const double next_s = 0.98e-3 * (test::uniform(random) - 0.5);
    go_to(z_m -= 1e-5);
    tick_after(1e-3 + next_s - off_s);
    off_s = next_s;
    ASSERT_EQ(state_.safety.fault, Fault::kNone) << k;
    const double damping_N = result_.contact.damping_N_s_per_m * result_.contact.rate_m_per_s;
    if (k < 3) continue;
    ASSERT_GE(damping_N, 0) << k << ": the velocity is that of a tip on its way in";
    ASSERT_LE(damping_N, 0.4 / kLeastInterval + 1e-6) << k;
  }
}

TEST_F(DeviceTime, AClockThatStandsStillIsAFault) {
  const double t_s = device_.next.t_s;
  for (int i = 0; i < 10; ++i) {
    tick_at(t_s);
    ASSERT_EQ(state_.safety.fault, i < 9 ? Fault::kNone : Fault::kNoData) << i;
  }
}

TEST_F(DeviceTime, AClockThatLeapsIsAFault) {
  tick_after(0.1 + 1e-6);
  EXPECT_EQ(state_.safety.fault, Fault::kNoData);
}

// Late ticks are no fault here, as in a session with a simulated drive.
TEST_F(DeviceTime, ALeapIsAFaultEvenIfLateTicksAreNone) {
  model_.limits.gap_max_s = 0;
  tick_after(0.5);
  EXPECT_EQ(state_.safety.fault, Fault::kNoData);
  EXPECT_EQ(result_.found.quantity, FaultQuantity::kTimeWithoutData);
  EXPECT_NEAR(result_.found.value, 0.5, 1e-9);
  EXPECT_EQ(result_.row.outside_fault, Fault::kNoData) << "a replay cannot know it";
}

TEST_F(DeviceTime, AStallOfThisComputerIsNoLeap) {
  model_.limits.gap_max_s = 0;
  tick_after(0.5, 0.5);
  EXPECT_EQ(state_.safety.fault, Fault::kNone);
  device_.on_read = DeviceStatus::kNoData;
  for (int i = 0; i < 5; ++i)
    tick(0.1);
  device_.on_read = DeviceStatus::kOk;
  tick_after(0.5);  // and 5 ms of the ticks without data
  EXPECT_EQ(state_.safety.fault, Fault::kNone);
  EXPECT_EQ(result_.row.outside_fault, Fault::kNone);
  tick_after(0.11);
  EXPECT_EQ(state_.safety.fault, Fault::kNoData) << "an old stall explains no new leap";
}

// This happens after a link was restored to a restarted drive.
TEST_F(DeviceTime, TheClockMayStartAgainWhileNoForcesAreRendered) {
  device_.on_read = DeviceStatus::kLinkLost;
  tick();
  ASSERT_EQ(state_.safety.fault, Fault::kLinkLost);
  ticks(10);
  ask_to_recover();
  device_.on_read = DeviceStatus::kOk;
  go_to(0.121);
  tick_at(0);
  for (int i = 0; state_.safety.state != SafetyState::kRunning && i < 400; ++i) {
    tick();
    ASSERT_EQ(result_.row.device_read, DeviceStatus::kOk);
    EXPECT_NEAR(state_.speed.twist_device.norm(), 0, 1e-9);
  }
  EXPECT_EQ(state_.safety.state, SafetyState::kRunning);
}

// A pause reads the device, but keeps nothing. The trainee draws the needle out meanwhile.
TEST_F(DeviceTime, AMotionDuringAPauseIsNoJumpAfterIt) {
  outside_ = Fault::kPaused;
  wait_for_zero_torques();
  outside_ = Fault::kNone;
  recover_ = true;
  go_to(0.14);
  tick_after(10);
  recover_ = false;
  EXPECT_EQ(state_.safety.state, SafetyState::kRecovering);
  EXPECT_EQ(result_.found.fault, Fault::kNone) << measured(result_.found);
  device_.next.encoder_rad[4] += 0.3;
  tick();
  EXPECT_EQ(result_.found.fault, Fault::kEncoderJump) << "the next reading is compared again";
}

// A late tick has held its torques for longer: every other one is three periods late here.
TEST_F(DeviceTime, HeatCountsTheTimeThatPassed) {
  description_.motor_continuous_torque_Nm = 0.5 * largest(good_);
  description_.motor_peak_torque_Nm = 1.5 * largest(good_);
  description_.motor_peak_time_s = 10;
  const MotorModel motor = make_motor_model(description_);
  const LoopState before = state_;
  const SheetLaw law_before = law_;
  const FourLegs device_before = *four_legs_;
  ticks(60);
  const double on_time = i2t_fraction_used(motor, four_legs_->motors().load);
  state_ = before;
  law_ = law_before;
  four_legs_.emplace(device_before);
  device_.next.t_s = before.reading_t_s;
  for (int i = 0; i < 30; ++i) {
    tick_after(1e-3);
    tick_after(4e-3);
  }
  EXPECT_NEAR(i2t_fraction_used(motor, four_legs_->motors().load) / on_time, 2.5, 0.1);
}

TEST_F(DeviceTime, ARecordingHoldsTheTimesAndReplays) {
  std::vector<RecordingRow> rows;
  restart();
  go_to(0.125);
  double z_m = 0.125;
  for (int i = 0; i < 400; ++i) {
    go_to(z_m -= 2e-5 * (i % 4));
    device_.on_read = i % 7 == 3 ? DeviceStatus::kNoData : DeviceStatus::kOk;
    tick_after(i % 11 == 5 ? -1e-3 : 1e-3 * (0.25 + i % 5));
    rows.push_back(result_.row);
  }
  ASSERT_EQ(state_.safety.fault, Fault::kNone) << to_string(state_.safety.fault);
  expect_replay(rows);
}

// The session's stall is not in the recording, but the leap is.
TEST_F(DeviceTime, ARecordingHoldsALeapAndReplays) {
  std::vector<RecordingRow> rows;
  restart();
  model_.limits.gap_max_s = 0;
  go_to(0.125);
  double z_m = 0.125;
  for (int i = 0; i < 420; ++i) {
    go_to(z_m -= 2e-5);
    const double gap_s = i == 300 ? 0.3 : 1e-3;
    tick_after(i == 400 ? 0.5 : gap_s, gap_s);
    rows.push_back(result_.row);
  }
  ASSERT_EQ(state_.safety.fault, Fault::kNoData);
  ASSERT_NEAR(state_.safety.fault_t_s, 0.4, 1e-9);
  ASSERT_GT(largest(DeviceCommand{rows[399].tau_Nm}), 0.01);
  expect_replay(rows);
}

// Ticks without data from the device while the tool moves on steadily: forces in the ticks with
// data are the same as if no data were missing. Velocities are taken over the time since the last
// data.

struct Felt {
  std::vector<double> force_N;  ///< wanted along z, tick by tick
  std::vector<bool> has_data;
  std::size_t punctured = 0;  ///< tick of the puncture
  double puncture_N = 0;
};

class TicksWithoutData : public testing_support::LoopFixture {
 protected:
  void SetUp() override {
    LoopFixture::SetUp();
    tissue_.damping_N_s_per_m = 40;
    tissue_.shaft.viscous_friction_N_s_per_m = 30;
  }
  /// Down at 50 mm/s through the sheet, from 1 mm above it.
  Felt descend(const std::function<bool(int)>& is_silent) {
    use(tissue_);
    restart();
    Felt felt;
    for (int i = 0; i < 300; ++i) {
      go_to(0.121 - 50e-6 * i);
      const bool silent = is_silent(i);
      device_.on_read = silent ? DeviceStatus::kNoData : DeviceStatus::kOk;
      tick();
      EXPECT_EQ(state_.safety.fault, Fault::kNone) << i << " " << to_string(state_.safety.fault);
      felt.force_N.push_back(result_.row.wrench_wanted[2]);
      felt.has_data.push_back(!silent);
      if (!result_.contact.punctured_now) continue;
      felt.punctured = felt.force_N.size() - 1;
      felt.puncture_N = result_.contact.trial_force_N;
    }
    return felt;
  }
  Tissue tissue_;
};

TEST_F(TicksWithoutData, ForcesEqualThoseOfARunWithAllData) {
  const Felt all = descend([](int) { return false; });
  ASSERT_GT(all.punctured, 100U);
  ASSERT_NEAR(all.force_N.back(), 1.5, 1e-6) << "the shaft's friction";
  const std::vector<std::function<bool(int)>> patterns = {
      [](int i) { return i > 30 && i % 2 == 0; },
      [](int i) { return i > 30 && i % 9 != 0; },
      [](int i) { return i >= 100 && i < 108; },
      [](int i) { return i >= 190 && i < 198; },
  };
  for (std::size_t p = 0; p < patterns.size(); ++p) {
    const Felt some = descend(patterns[p]);
    EXPECT_GE(some.punctured, all.punctured) << p << ": before the threshold was reached";
    EXPECT_LE(some.punctured, all.punctured + 8) << p;
    EXPECT_LE(some.puncture_N, all.puncture_N + 8 * 5000 * 50e-6 + 1e-6) << p;
    std::size_t same = 0;
    for (std::size_t i = 30; i < all.force_N.size(); ++i) {
      if (i >= all.punctured && i <= some.punctured + 9) continue;
      const double expected_N = some.has_data[i] ? all.force_N[i] : some.force_N[i - 1];
      ASSERT_NEAR(some.force_N[i], expected_N, 1e-6) << p << ", tick " << i;
      ++same;
    }
    EXPECT_GT(same, 180U);
  }
}

TEST_F(TicksWithoutData, ACouplingHasNoForceSpikeAfterThem) {
  law_.coupling_options().on = true;
  tissue_.damping_N_s_per_m = 0;
  const Felt all = descend([](int) { return false; });
  const Felt some = descend([](int i) { return i > 30 && i % 9 != 0; });
  ASSERT_GT(all.punctured, 200U);
  EXPECT_GE(some.punctured + 1, all.punctured);
  for (std::size_t i = 60; i < all.punctured; ++i) {
    const double expected_N = some.has_data[i] ? all.force_N[i] : some.force_N[i - 1];
    ASSERT_NEAR(some.force_N[i], expected_N, 1e-3) << "tick " << i;
  }
}

TEST_F(TicksWithoutData, SpeedIsHeldOverThem) {
  const auto twist_after = [&](int silent) {
    descend([&](int i) { return i >= 299 - silent && i < 299; });
    return state_.speed.twist_device;
  };
  for (const int silent : {1, 4, 8}) {
    descend([&](int i) { return i >= 300 - silent; });
    EXPECT_NEAR(state_.speed.twist_device[2], -0.05, 1e-4) << silent;
    EXPECT_NEAR(twist_after(silent)[2], -0.05, 1e-4) << silent;
  }
}

// Loop and device both run at 100 Hz: now and then a tick finds no new state, and one may be lost.
TEST_F(TicksWithoutData, AtALowRateThreeInARowAreAFault) {
  model_.rate_Hz = 100;
  restart();
  go_to(0.125);
  ticks(5);
  ASSERT_EQ(state_.safety.state, SafetyState::kRunning);
  device_.on_read = DeviceStatus::kNoData;
  for (int i = 0; i < 2; ++i) {
    tick();
    EXPECT_EQ(state_.safety.fault, Fault::kNone) << i;
  }
  tick();
  EXPECT_EQ(state_.safety.fault, Fault::kNoData);
  EXPECT_EQ(result_.found.limit, 0.03);
}

}  // namespace
}  // namespace trocar::runtime
