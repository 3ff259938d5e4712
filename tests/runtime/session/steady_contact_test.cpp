// SPDX-License-Identifier: Apache-2.0 Contact by the real loop on devices that are noisy, coarse
// and late: a plate of one direction, integrated here in steps of 25 us, with a hand, dry friction,
// readings and delay of its own. At the stiffness of the rule a contact is quiet, passive and as
// stiff as it should be.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <deque>
#include <functional>
#include <limits>
#include <memory>
#include <numbers>
#include <random>
#include <string>
#include <vector>

#include "runtime/device/pose/pose_hand.h"
#include "runtime/haptics/contact_design.h"
#include "runtime/session/open_device.h"
#include "runtime/session/pose_session.h"
#include "runtime/session/session.h"
#include "tests/support/body_fixture.h"

namespace trocar::runtime {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kSurface_m = 0.15;

/// What a device is.
struct Plate {
  const char* name;
  double mass_kg, damping_N_s_per_m, coulomb_N;
};
constexpr Plate kPlates[] = {
    {"legs", 1.2, 2, 0}, {"inverse3", 0.3, 1, 0.1}, {"omega", 0.25, 1, 0.05}};

struct Sensor {
  double noise_m, resolution_m;
};
constexpr Sensor kSensors[] = {{0, 1.53e-4}, {0, 9.6e-6},  {0, 6e-7},
                               {5e-6, 1e-6}, {2e-5, 1e-6}, {5e-5, 1e-6}};

struct Hand {
  double mass_kg = 0.1, stiffness_N_per_m = 1000, damping_N_s_per_m = 10;
  double force_N = 5;
  double tremor_m = 3e-4, drift_m_per_s = 2e-4;  ///< tremor of 9 Hz; drift from 1 s on
  double kick_N = 0;                             ///< from 1 to 1.01 s
};

/// Depth x below the surface along -z. Either a hand moves the plate, or the motion is imposed.
class OneDirection final : public PoseDevice {
 public:
  OneDirection(const Plate& plate, const Sensor& sensor, const Hand& hand, int delay_ticks,
               double rest_m)
      : plate_(plate), sensor_(sensor), hand_(hand), rest_m_(rest_m) {
    waiting_.assign(static_cast<std::size_t>(delay_ticks), 0.0);
  }
  /// Imposes the motion x(t).
  std::function<double(double)> imposed;

  DeviceStatus read(PoseReading& reading) noexcept override {
    reading.t_s = std::round(t_s_ * 1e9) / 1e9;
    reading.p_m = {measured(0), measured(0), measured(-x_m_)};
    return DeviceStatus::kOk;
  }
  DeviceStatus write(const HandleWrench& wrench) noexcept override {
    command_N_ = wrench[2];
    return DeviceStatus::kOk;
  }
  void advance(double dt_s) override {
    waiting_.push_back(command_N_);
    held_N = waiting_.front();
    waiting_.pop_front();
    const int steps = std::max(8, static_cast<int>(std::ceil(dt_s / 2.5e-5)));
    const double h_s = dt_s / steps, mass_kg = plate_.mass_kg + hand_.mass_kg;
    for (int i = 0; i < steps; ++i) {
      const double t_s = t_s_ + i * h_s, before_m = x_m_;
      if (imposed) {
        x_m_ = imposed(t_s + h_s);
      } else {
        v_m_per_s += h_s * (hand_N(t_s) - held_N) / mass_kg;
        v_m_per_s /= 1 + plate_.damping_N_s_per_m * h_s / mass_kg;
        const double dry = plate_.coulomb_N * h_s / mass_kg;
        v_m_per_s = v_m_per_s > dry ? v_m_per_s - dry : v_m_per_s < -dry ? v_m_per_s + dry : 0;
        x_m_ += h_s * v_m_per_s;
      }
      work_J += held_N * (x_m_ - before_m);
      if (each_step) each_step(t_s + 0.5 * h_s, h_s, held_N, x_m_ - before_m);
      given_J = std::max(given_J, -work_J);
    }
    t_s_ += dt_s;
  }
  bool is_paced_by_loop() const override { return true; }

  double v_m_per_s = 0.02, held_N = 0;
  double work_J = 0, given_J = 0;  ///< taken from the hand; most that it was given
  std::function<void(double t_s, double h_s, double held_N, double step_m)> each_step;

 private:
  double measured(double value_m) {
    if (sensor_.resolution_m > 0)
      value_m = sensor_.resolution_m * std::floor(value_m / sensor_.resolution_m + 0.5);
    return value_m + sensor_.noise_m * noise_(random_);
  }
  double hand_N(double t_s) const {
    const double ramp = std::min(1.0, t_s / 0.5), k = hand_.stiffness_N_per_m;
    const double kick_N = t_s > 1 && t_s < 1.01 ? hand_.kick_N : 0;
    if (!(k > 0)) return hand_.force_N * ramp + kick_N;
    const double target_m = ramp * (rest_m_ + hand_.force_N / k) +
                            hand_.tremor_m * std::sin(2 * kPi * 9 * t_s) +
                            hand_.drift_m_per_s * std::max(0.0, t_s - 1);
    return k * (target_m - x_m_) - hand_.damping_N_s_per_m * v_m_per_s + kick_N;
  }

  Plate plate_;
  Sensor sensor_;
  Hand hand_;
  double rest_m_;
  double t_s_ = 0, x_m_ = -1e-3, command_N_ = 0;
  std::deque<double> waiting_;
  std::mt19937_64 random_{12345};
  std::normal_distribution<double> noise_;
};

struct Row {
  Plate plate = kPlates[0];
  double rate_Hz = 1000, K = 1000;
  Sensor sensor{0, 0};
  int delay_ticks = 0;
  int told_delay_ticks = -1;  ///< -1: the true one
  ForceLawKind law = ForceLawKind::kHooke;

  PoseDeviceDescription description() const {
    PoseDeviceDescription out;
    out.name = plate.name;
    out.force_max_N = 1000;
    out.mass_kg = plate.mass_kg;
    out.damping_N_s_per_m = plate.damping_N_s_per_m;
    out.coulomb_friction_N = plate.coulomb_N;
    out.position_resolution_m = sensor.resolution_m;
    out.position_noise_m = sensor.noise_m;
    out.delay_s = (told_delay_ticks < 0 ? delay_ticks : told_delay_ticks) / rate_Hz;
    out.workspace_min_m = {-0.2, -0.2, -0.2};
    out.workspace_max_m = {0.2, 0.2, 0.2};
    return out;
  }
  LoopTiming timing() const { return {1 / rate_Hz, delay_ticks / rate_Hz}; }
  PlateAxis axis() const {
    return {plate.mass_kg, plate.damping_N_s_per_m, sensor.noise_m, sensor.resolution_m};
  }
  /// The stiffness of the rule, at most `asked`.
  double by_rule(double asked) const {
    return quiet_stiffness(timing(), axis(), std::min(asked, stable_stiffness(timing(), axis())));
  }
  std::string name() const {
    return std::string(plate.name) + ", " + std::to_string(int(rate_Hz)) + " Hz, delay " +
           std::to_string(delay_ticks) + ", noise " + std::to_string(sensor.noise_m * 1e6) +
           " um, resolution " + std::to_string(sensor.resolution_m * 1e6) + " um, " +
           std::to_string(K) + " N/m, " + to_string(law);
  }
};

/// Notes the forces of all ticks.
class ContactForces final : public TickObserver {
 public:
  explicit ContactForces(std::size_t ticks) {
    commanded_N.reserve(ticks);
    guard.reserve(ticks);
  }
  void on_tick(const TickView& tick) noexcept override {
    commanded_N.push_back(tick.result.row.wrench_delivered[2]);
    guard.push_back(tick.result.row.guard);
  }
  void on_message(const OperatorMessage& message) noexcept override {
    is_told |= message.kind == OperatorMessage::Kind::kSoftened;
  }
  std::vector<double> commanded_N, guard;
  bool is_told = false;
};

struct ContactRun {
  Result<SessionResult> result = SessionResult{};
  std::vector<double> commanded_N, guard;
  bool is_told = false;
};

/// A session of the real loop, in virtual time.
ContactRun run(const Row& row, OneDirection& device, double duration_s) {
  Scene scene = test::descent_scene({kSurface_m}, kSurface_m, kSurface_m, 0.01);
  scene.hand.trajectory = {{0, {0, 0, kSurface_m}, {}}};
  scene.tool.tip_in_plate_m = {0, 0, 0};
  scene.tissue.stiffness_N_per_m = row.K;
  scene.tissue.threshold_N = 1e5;
  scene.force_law.kind = row.law;
  if (row.law == ForceLawKind::kCutting) {
    scene.tissue.threshold_N = 500;
    scene.force_law.axis = ToolAxis::kCoupled;
  }
  scene.duration_s = duration_s;
  const PoseDeviceDescription description = row.description();
  SessionOptions options;
  options.clock = Clock::kVirtual;
  options.rate_Hz = row.rate_Hz;
  options.duration_s = duration_s;
  set_pose_device_options(description, scene, options);
  options.coupling.on = false;
  ContactForces forces(tick_count(duration_s, row.rate_Hz));
  options.observers = {&forces};
  const PoseFrame frame = pose_frame(description, scene);
  PoseHand hand(description, frame, device);
  auto sheets = place_slices(scene, test::square_asset(1), "steady");
  EXPECT_TRUE(sheets) << sheets.error().message;
  Remesher remesher(*sheets);
  ContactRun out;
  out.result = run_session(
      scene, remesher, hand, [&](double dt_s) { device.advance(dt_s); }, options);
  out.commanded_N = std::move(forces.commanded_N);
  out.guard = std::move(forces.guard);
  out.is_told = forces.is_told;
  return out;
}

/// Largest change from tick to tick that the next tick takes back at least as much of.
double alternation_N(const std::vector<double>& force_N, std::size_t from) {
  double most = 0;
  for (std::size_t i = std::max<std::size_t>(2, from); i < force_N.size(); ++i) {
    const double now = force_N[i] - force_N[i - 1], before = force_N[i - 1] - force_N[i - 2];
    if (now * before < 0) most = std::max(most, std::min(std::abs(now), std::abs(before)));
  }
  return most;
}

class Grid : public testing::TestWithParam<ForceLawKind> {};
INSTANTIATE_TEST_SUITE_P(Steady, Grid,
                         testing::Values(ForceLawKind::kHooke, ForceLawKind::kNetwork,
                                         ForceLawKind::kCutting),
                         [](const auto& law) { return std::string(to_string(law.param)); });

template <typename Each>
void for_each_row(ForceLawKind law, Each&& each) {
  for (const Plate& plate : kPlates)
    for (const double rate_Hz : {250.0, 1000.0, 4000.0, 8000.0})
      for (const double asked : {1000.0, 3000.0, 20'000.0})
        for (const Sensor& sensor : kSensors)
          for (const int delay : {0, 1}) {
            if (law == ForceLawKind::kCutting && asked > 1000) continue;  // it chooses its own
            Row row{plate, rate_Hz, asked, sensor, delay, -1, law};
            each(row, asked);
          }
}

TEST_P(Grid, AtTheStiffnessOfTheRuleAContactIsQuiet) {
  constexpr double kForce_N = 5;
  int rows = 0, above = 0;
  for_each_row(GetParam(), [&](Row& row, double asked) {
    if (row.law != ForceLawKind::kCutting) row.K = row.by_rule(asked);
    if (row.law == ForceLawKind::kCutting) row.K = 10'000;
    ASSERT_GT(row.K, 0) << row.name();
    OneDirection device(row.plate, row.sensor, {}, row.delay_ticks, kForce_N / row.K);
    const ContactRun done = run(row, device, 3);
    ASSERT_TRUE(done.result) << row.name() << ": " << done.result.error().message;
    ASSERT_EQ(done.result->fault, Fault::kNone) << row.name();
    const double found_N =
        alternation_N(done.commanded_N, static_cast<std::size_t>(1.5 * row.rate_Hz));
    EXPECT_LE(found_N, quiet_N(kForce_N)) << row.name();
    EXPECT_EQ(*std::min_element(done.guard.begin(), done.guard.end()), 1) << row.name();
    EXPECT_GT(done.commanded_N.back(), 0.5) << row.name() << ": it is in contact";
    ++rows;
    above += found_N > quiet_N(kForce_N);
  });
  std::printf("%d of %d rows alternate by more than max(0.1 N, 1 %%)\n", above, rows);
}

struct Felt {
  double stiffness_N_per_m = 0, damping_N_s_per_m = 0;
};
Felt imposed(const Row& row, double frequency_Hz) {
  constexpr double kAmplitude_m = 5e-4, kSettle_s = 0.5;
  const double w = 2 * kPi * frequency_Hz, cycles = std::ceil(frequency_Hz),
               end_s = kSettle_s + cycles / frequency_Hz;
  const double deep_m = 4 * kAmplitude_m + 5 / row.K;
  OneDirection device(row.plate, row.sensor, {}, row.delay_ticks, 0);
  device.imposed = [=](double t_s) {
    const double ramp = std::min(1.0, t_s / 0.3);
    return -1e-3 + (deep_m + 1e-3) * ramp + ramp * kAmplitude_m * std::sin(w * t_s);
  };
  double in_phase = 0, work_J = 0, all_s = 0;
  device.each_step = [&](double t_s, double h_s, double held_N, double) {
    if (t_s < kSettle_s || t_s >= end_s) return;
    in_phase += held_N * std::sin(w * t_s) * h_s;
    work_J += held_N * kAmplitude_m * w * std::cos(w * t_s) * h_s;
    all_s += h_s;
  };
  const ContactRun done = run(row, device, end_s + 0.01);
  EXPECT_TRUE(done.result) << row.name();
  return {2 * in_phase / all_s / kAmplitude_m,
          work_J / (kAmplitude_m * kAmplitude_m * w * w / 2 * all_s)};
}

TEST(Steady, LoopAndDeviceAreNeverActiveAndAsStiffAsAsked) {
  double softest = 1, stiffest = 1;
  for_each_row(ForceLawKind::kHooke, [&](Row& row, double asked) {
    row.K = row.by_rule(asked);
    for (const double frequency_Hz : {10.0, 30.0, 60.0}) {
      const Felt felt = imposed(row, frequency_Hz);
      EXPECT_GE(felt.damping_N_s_per_m + row.plate.damping_N_s_per_m, 0)
          << row.name() << " at " << frequency_Hz << " Hz";
      if (frequency_Hz > 10 || row.rate_Hz < 1000) continue;
      const double share = felt.stiffness_N_per_m / row.K;
      EXPECT_NEAR(share, 1, 0.06) << row.name();
      softest = std::min(softest, share);
      stiffest = std::max(stiffest, share);
    }
  });
  std::printf("felt at 10 Hz: %.3f to %.3f of K\n", softest, stiffest);
}

// Dead weight that pushes with 5 N and is kicked: 162 rows, those inside the rule for stability.
TEST(Steady, AKickedHandOfDeadWeightComesToRestInsideTheRule) {
  int inside = 0, refused_rows = 0;
  for (const Plate& of : kPlates)
    for (const double rate_Hz : {250.0, 1000.0, 4000.0})
      for (const int delay : {0, 1, 2})
        for (const double K : {500.0, 1500.0, 3000.0, 8000.0, 20'000.0, 60'000.0}) {
          Plate plate = of;
          plate.coulomb_N = 0;
          const Row row{plate, rate_Hz, K, {0, 1e-6}, delay};
          const Hand hand{.mass_kg = 0.05,
                          .stiffness_N_per_m = 0,
                          .damping_N_s_per_m = 0,
                          .tremor_m = 0,
                          .drift_m_per_s = 0,
                          .kick_N = 3};
          OneDirection device(plate, row.sensor, hand, delay, 0);
          double early = 0, late = 0;
          device.each_step = [&](double t_s, double, double, double) {
            const double speed = std::abs(device.v_m_per_s);
            if (t_s > 1.1 && t_s < 1.6) early = std::max(early, speed);
            if (t_s > 2.5) late = std::max(late, speed);
          };
          const ContactRun done = run(row, device, 3);
          const bool is_inside = K <= stable_stiffness(row.timing(), row.axis());
          EXPECT_EQ(static_cast<bool>(done.result), is_inside) << row.name();
          if (!done.result) {
            ++refused_rows;
            continue;
          }
          ++inside;
          EXPECT_EQ(done.result->fault, Fault::kNone) << row.name();
          EXPECT_TRUE(late < 2e-3 || late < 0.95 * early)
              << row.name() << ": " << early << ", " << late << " m/s";
          EXPECT_EQ(*std::min_element(done.guard.begin(), done.guard.end()), 1) << row.name();
        }
  EXPECT_EQ(inside + refused_rows, 162);
  std::printf("%d rows inside the rule, %d refused\n", inside, refused_rows);
}

// The description is silent about two ticks of delay.
TEST(Steady, AnUndeclaredDelayIsSoftenedAndTold) {
  for (const double noise_m : {0.0, 2e-5}) {
    Row row{kPlates[1], 1000, 12'000, {noise_m, 1e-6}, 2, 0};
    const Hand hand{.damping_N_s_per_m = 5, .kick_N = 3};
    OneDirection device(row.plate, row.sensor, hand, row.delay_ticks, 5 / row.K);
    double late_N = 0;
    device.each_step = [&](double t_s, double, double held_N, double) {
      if (t_s > 2.5) late_N = std::max(late_N, std::abs(held_N - 5));
    };
    const ContactRun done = run(row, device, 3);
    ASSERT_TRUE(done.result) << done.result.error().message;
    EXPECT_EQ(done.result->fault, Fault::kNone);
    EXPECT_LE(late_N, 2) << noise_m;
    EXPECT_LE(device.given_J, 0.02) << noise_m;
    EXPECT_TRUE(done.is_told);
    EXPECT_LT(done.result->guard_least, 1);
    std::printf("noise %.0f um: within %.2f N, %.4f J, softened to %.2f\n", noise_m * 1e6, late_N,
                device.given_J, done.result->guard_least);
  }
}

}  // namespace
}  // namespace trocar::runtime
