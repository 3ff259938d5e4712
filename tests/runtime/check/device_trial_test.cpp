// SPDX-License-Identifier: Apache-2.0
// The verdict on a device: each planted trouble is named, and alone; noise is measured apart from motion.
#include "runtime/check/device_trial.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <functional>
#include <numbers>
#include <random>

#include "runtime/device/four_legs/four_legs.h"
#include "runtime/device/pose/pose_hand.h"
#include "runtime/device/simulated/simulated_device.h"
#include "tests/support/uniform.h"

namespace trocar::runtime {
namespace {

constexpr std::int64_t kMs = 1'000'000;

/// A trial of 5 s at 1 kHz without any trouble.
DeviceTrial good_trial() {
  DeviceTrial trial;
  trial.ticks = trial.readings = 5000;
  trial.link.emplace();
  trial.link->packets.emplace();
  for (int i = 0; i < 5000; ++i) {
    trial.state_interval.add(kMs);
    trial.without_state.add(kMs + (i % 3) * kMs / 10);
    trial.realtime.wake.add(20'000);
    trial.link->round_trip.add(kMs / 2);
    trial.link->packets->counts.add(LinkRefusal::kNone);
  }
  trial.position_noise_m = 1e-6;
  return trial;
}

const FourLegsSpecification& four_legs() {
  static const FourLegsSpecification specification(default_device_description());
  return specification;
}

/// The only trouble of this trial; empty: there is none.
std::string trouble_of(const DeviceTrial& trial, const SessionOptions& options = {},
                       const DeviceSpecification& specification = four_legs()) {
  const DeviceVerdict verdict = describe(trial, options, specification);
  EXPECT_LE(verdict.troubles.size(), 1U);
  return verdict.troubles.empty() ? std::string() : verdict.troubles[0];
}

void expect_has(const std::string& text, const std::string& words) {
  EXPECT_NE(text.find(words), std::string::npos) << text;
}

struct Planted {
  const char* words;
  std::function<void(DeviceTrial& trial)> plant;
};

TEST(DeviceVerdict, NamesEachTroubleAndNoOther) {
  EXPECT_EQ(trouble_of(good_trial()), "");
  const Planted all[] = {
      {"sent no state", [](DeviceTrial& t) { t.readings = 0; }},
      {"3 ticks late in a row", [](DeviceTrial& t) { t.realtime.missed_in_row_max = 3; }},
      {"only 100 times a second",
       [](DeviceTrial& t) {
         t.state_interval = {};
         for (int i = 0; i < 500; ++i)
           t.state_interval.add(10 * kMs);
       }},
      {"silent for up to 3.5 ms, 4 times",
       [](DeviceTrial& t) { t.without_state.add(3 * kMs + kMs / 2); }},
      {"silent for up to 12.0 ms, and 10 ms",
       [](DeviceTrial& t) { t.without_state.add(12 * kMs); }},
      {"answered after 6",
       [](DeviceTrial& t) {
         for (int i = 0; i < 100; ++i)
           t.link->round_trip.add(6 * kMs);
       }},
      {"2.0 % of the device's states were lost",
       [](DeviceTrial& t) { t.link->packets->states_missed = 102; }},
      {"the position trembles by 50 um at rest", [](DeviceTrial& t) { t.position_noise_m = 5e-5; }},
      {"joint_limit", [](DeviceTrial& t) { t.fault = Fault::kJointLimit; }},
      {"in 7 ticks", [](DeviceTrial& t) { t.lost_ticks = 7; }},
  };
  for (const Planted& planted : all) {
    DeviceTrial trial = good_trial();
    planted.plant(trial);
    expect_has(trouble_of(trial), planted.words);
  }
}

TEST(DeviceVerdict, LateTicksAreATroubleBeyondTheSessionsLimit) {
  DeviceTrial trial = good_trial();
  trial.realtime.missed_in_row_max = 5;
  SessionOptions options;
  EXPECT_NE(trouble_of(trial, options), "");
  options.limits.missed_deadlines_max = 5;
  EXPECT_EQ(trouble_of(trial, options), "");
  options.limits.missed_deadlines_max = 4;
  expect_has(trouble_of(trial, options), "5 end a session (deadline_missed)");
}

TEST(DeviceVerdict, ASilenceEndsASessionOnlyFromItsLimitOn) {
  DeviceTrial trial = good_trial();
  trial.without_state.add(12'000'000);
  SessionOptions options;
  options.limits.no_data_max_s = 0.25;
  expect_has(trouble_of(trial, options), "forces jump after that");
  trial.without_state.add(251'000'000);
  expect_has(trouble_of(trial, options), "250 ms without a state end a session");
}

/// The verdict on a device of 0.2 x 0.2 x 0.1 m with y up, whose handle is at this pose in the scene's axes.
DeviceVerdict verdict_at(const Pose& T_device_plate) {
  PoseDeviceDescription description;
  description.workspace_min_m = {-0.1, 0.2, -0.1};
  description.workspace_max_m = {0.1, 0.3, 0.1};
  description.turn_rad = {std::numbers::pi / 2, 0, 0};
  Pose middle;
  middle.p_m.z() = 0.3;
  const PoseSpecification specification(description, PoseFrame(description, middle));
  DeviceTrial trial = good_trial();
  trial.last_T_device_plate = T_device_plate;
  return describe(trial, {}, specification);
}

TEST(DeviceVerdict, SaysWhereTheHandleIs) {
  Pose T;
  T.p_m << 0.0125, -0.02, 0.349;
  T.q = Eigen::AngleAxisd(0.55, Eigen::Vector3d::UnitY());
  const DeviceVerdict good = verdict_at(T);
  EXPECT_TRUE(good.troubles.empty());
  expect_has(good.text,
             "x +12.5, y -20.0, z +49.0 mm from the middle of the workspace, tilted by 31.5 deg");

  Pose tilted = T;
  tilted.q = Eigen::AngleAxisd(0.65, Eigen::Vector3d::UnitY());
  const DeviceVerdict oblique = verdict_at(tilted);
  ASSERT_EQ(oblique.troubles.size(), 1U);
  expect_has(oblique.troubles[0],
             "tilted by 37.2 deg, and more than 34.4 deg end a session (workspace)");

  T.p_m.z() = 0.352;
  const DeviceVerdict outside = verdict_at(T);
  ASSERT_EQ(outside.troubles.size(), 1U);
  expect_has(outside.troubles[0],
             "at z +52.0 mm from the middle, which is reachable from -50.0 to +50.0 mm");

  EXPECT_EQ(describe(good_trial(), {}, four_legs()).text.find("at the end"), std::string::npos)
      << "no pose was accepted";
}

TEST(DeviceVerdict, SaysThatTheHandleIsOutsideATurnedBox) {
  PoseDeviceDescription description;
  description.workspace_min_m = {-0.1, -0.1, -0.1};
  description.workspace_max_m = {0.1, 0.1, 0.1};
  description.turn_rad = {0, 0, std::numbers::pi / 4};
  const PoseSpecification specification(description, PoseFrame(description, Pose{}));
  DeviceTrial trial = good_trial();
  trial.last_T_device_plate = Pose{};
  EXPECT_EQ(trouble_of(trial, {}, specification), "");
  // Within the box along the scene's axes, which reaches to 141 mm.
  trial.last_T_device_plate->p_m << 0.09, 0.09, 0;
  expect_has(trouble_of(trial, {}, specification), "the handle is at ");
  expect_has(trouble_of(trial, {}, specification), "a session would end at once (workspace)");
}

TEST(DeviceVerdict, AtALowRateASilenceOfTwoTicksEndsNoSession) {
  DeviceTrial trial = good_trial();
  trial.state_interval = {};
  trial.without_state = {};
  for (int i = 0; i < 500; ++i) {
    trial.state_interval.add(10 * kMs);
    trial.without_state.add(10 * kMs);
  }
  trial.without_state.add(20 * kMs);
  SessionOptions options;
  options.rate_Hz = 100;
  EXPECT_EQ(trouble_of(trial, options), "");
}

TEST(NoiseMeter, MeasuresNoiseAndNotMotion) {
  std::mt19937_64 random(5);
  NoiseMeter still, moving, quiet;
  for (int i = 0; i < 20'000; ++i) {
    const double noise = (test::uniform(random) - 0.5) * std::sqrt(12);  // deviation 1
    still.add(noise);
    moving.add(noise + 3e-3 * i + 40 * std::sin(1e-3 * i));
    quiet.add(7 + 0.25 * i);
  }
  EXPECT_NEAR(still.deviation(), 1, 0.03);
  EXPECT_NEAR(moving.deviation(), 1, 0.03);
  EXPECT_NEAR(quiet.deviation(), 0, 1e-9);
  EXPECT_EQ(NoiseMeter().deviation(), 0);
}

/// Encoders of a device at rest, with a new state in every tick but some.
class StillDevice final : public Device {
 public:
  DeviceStatus read(DeviceState& state) override {
    t_s_ += 1e-3;
    if (++ticks_ % 10 == 0) return DeviceStatus::kNoData;
    state.t_s = t_s_;
    state.encoder_rad = encoder_rad;
    return DeviceStatus::kOk;
  }
  DeviceStatus write(const DeviceCommand& command) override {
    for (const double tau : command.tau_motor_Nm)
      largest_Nm = std::max(largest_Nm, std::abs(tau));
    ++writes;
    return DeviceStatus::kOk;
  }
  std::array<double, kEncoders> encoder_rad{};
  double largest_Nm = 0;
  int writes = 0;

 private:
  double t_s_ = 0;
  int ticks_ = 0;
};

// The answers of simulated devices whose description is known.
TEST(DeviceResponse, IsThatOfTheSimulatedDevice) {
  for (const double delay_s : {0.0, 1e-3, 3e-3}) {
    for (const double coulomb_N : {0.0, 0.1}) {
      PoseDeviceDescription device;
      device.name = "arm";
      device.force_max_N = 5;
      device.mass_kg = 0.3;
      device.damping_N_s_per_m = 1.5;
      device.coulomb_friction_N = coulomb_N;
      device.position_resolution_m = 5e-6;
      device.position_noise_m = 2e-6;
      device.delay_s = delay_s;
      device.workspace_min_m = {-0.1, -0.1, -0.1};
      device.workspace_max_m = {0.1, 0.1, 0.1};
      auto made = SimulatedPoseDevice::make(device, PoseFrame(device, Pose{}), HandTrajectory{},
                                            HandImpedance{}, Pose{});
      ASSERT_TRUE(made) << made.error().message;
      PoseHand hand(device, PoseFrame(device, Pose{}), *made);
      ResponsePush push(1, 1e-3);
      double t_s = 0, scale = 0, last_m = 0;
      while (!push.is_done()) {
        PlatePose pose;
        ASSERT_EQ(hand.read(t_s), DeviceStatus::kOk);
        ASSERT_EQ(hand.find_pose({}, pose), Fault::kNone);
        last_m = pose.T_device_plate.p_m.x();
        ASSERT_LE(std::abs(last_m), 2 * ResponsePush::kFarthest_m);
        RenderInput input;
        input.wanted[0] = push.take(last_m);
        ASSERT_LE(std::abs(input.wanted[0]), 1);
        ASSERT_EQ(hand.render(input, scale), Fault::kNone);
        hand.write();
        hand.advance(1e-3);
      }
      const auto found = fit_response(push.samples());
      ASSERT_TRUE(found);
      EXPECT_NEAR(found->mass_kg, 0.3, 0.01);
      EXPECT_NEAR(found->damping_N_s_per_m, 1.5, 0.15);
      EXPECT_NEAR(found->coulomb_N, coulomb_N, 0.02);
      EXPECT_NEAR(found->delay_s, delay_s, 1e-4);
      EXPECT_LT(found->misfit_m, 2e-5);
    }
  }
}

// A device without friction would coast away.
TEST(DeviceResponse, TheFreestDeviceStaysNearAndIsBraked) {
  for (const double mass_kg : {0.1, 0.3, 1.2}) {
    for (const double force_N : {1.0, 5.0}) {
      for (const double damping : {0.0, 1.0}) {
        ResponsePush push(force_N, 1e-3);
        double x_m = 0, v_m_per_s = 0, most_m_per_s = 0;
        while (!push.is_done()) {
          const double force_now_N = push.take(x_m);
          v_m_per_s += 1e-3 * (force_now_N - damping * v_m_per_s) / mass_kg;
          x_m += 1e-3 * v_m_per_s;
          most_m_per_s = std::max(most_m_per_s, std::abs(v_m_per_s));
          ASSERT_LE(std::abs(x_m), ResponsePush::kFarthest_m) << mass_kg << " " << force_N;
        }
        EXPECT_LT(std::abs(v_m_per_s), 0.35 * most_m_per_s)
            << mass_kg << " " << force_N << " " << damping;
      }
    }
  }
}

TEST(DeviceResponse, NoMotionIsNoAnswer) {
  ResponsePush push(1, 1e-3);
  while (!push.is_done())
    push.take(0.01);
  EXPECT_FALSE(fit_response(push.samples()));
}

TEST(DeviceVerdict, ADelayThatIsStatedTooShortIsATrouble) {
  DeviceTrial trial = good_trial();
  trial.was_pushed = true;
  expect_has(trouble_of(trial), "let go of the handle");
  trial.response = DeviceResponse{0.35, 1.9, 0, 2e-4, 1e-6};
  EXPECT_EQ(trouble_of(trial), "");
  trial.response->delay_s = 2e-3;
  expect_has(trouble_of(trial), "\"delay_s\": 0.0020");
  DeviceDescription honest = default_device_description();
  honest.delay_s = 2e-3;
  EXPECT_EQ(trouble_of(trial, {}, FourLegsSpecification(honest)), "");
}

TEST(DeviceTrial, CommandsNoForceAndCountsWhatTheDeviceSends) {
  const DeviceDescription description = default_device_description();
  Pose T;
  T.p_m.z() = 0.15;
  StillDevice still;
  still.encoder_rad = encoder_angles(inverse_kinematics(description, T).joints);
  FourLegs device(description, still);
  SessionOptions options;
  options.duration_s = 0.2;
  const auto trial = try_device(device, options);
  ASSERT_TRUE(trial) << trial.error().message;
  EXPECT_EQ(trial->ticks, 200U);
  EXPECT_EQ(trial->readings, 180U);
  EXPECT_EQ(trial->fault, Fault::kNone);
  EXPECT_EQ(trial->position_noise_m, 0);
  ASSERT_TRUE(trial->last_T_device_plate);
  EXPECT_NEAR(trial->last_T_device_plate->p_m.z(), 0.15, 1e-4);
  const std::string text = describe(*trial, options, device.specification()).text;
  expect_has(text, "z +150.0 mm from the device's origin, tilted by 0.0 deg");
  EXPECT_EQ(still.largest_Nm, 0);
  EXPECT_EQ(still.writes, 201) << "one in each tick, and one at the end";
}

TEST(DeviceTrial, GivesNoResultIfItIsStopped) {
  const DeviceDescription description = default_device_description();
  StillDevice still;
  FourLegs device(description, still);
  const std::atomic<bool> stop{true};
  SessionOptions options;
  options.duration_s = 0.2;
  options.stop = &stop;
  const auto trial = try_device(device, options);
  ASSERT_FALSE(trial);
  EXPECT_EQ(trial.error().code, ExitCode::kDeviceFault);
  expect_has(trial.error().message, "interrupted");
  EXPECT_EQ(still.writes, 1) << "the forces are zero at the end";
}

}  // namespace
}  // namespace trocar::runtime
