// SPDX-License-Identifier: Apache-2.0
// The window over which velocities are taken, on encoders of known motion and resolution.
#include "runtime/haptics/loop/passivity.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <numbers>
#include <random>
#include <utility>

namespace trocar::runtime {
namespace {

constexpr double kPeriod_s = 1e-3;
constexpr double kCount_rad = 2 * std::numbers::pi / 20'000;

/// A plate at a height of 0.1 m per radian of each encoder.
struct Motion {
  explicit Motion(std::function<double(double)> angle, double count = 0)
      : angle_rad(std::move(angle)), count_rad(count) {}
  std::function<double(double)> angle_rad;
  double count_rad;
  VelocityWindow window;
  Pose last, newest;
  double last_t_s = 0, newest_t_s = 0;

  void at(double t_s) {
    Measurement state{t_s, kMaxMeasured, {}};
    for (std::size_t i = 0; i < kMaxMeasured; ++i) {
      // Each encoder has another zero, so that counts come at different times.
      const double exact = angle_rad(t_s) + 0.1 * static_cast<double>(i) * kCount_rad;
      state.value[i] = count_rad > 0 ? std::round(exact / count_rad) * count_rad : exact;
    }
    last = newest;
    last_t_s = newest_t_s;
    newest.p_m.z() = 0.1 * state.value[0];
    newest_t_s = t_s;
    window.add(state, newest);
  }
  double velocity() const {
    const PreviousPose begin = window.begin(count_rad, kPeriod_s);
    const Pose& from = begin.ago_s > 0 ? begin.T_device_plate : last;
    const double over_s = begin.ago_s > 0 ? begin.ago_s : newest_t_s - last_t_s;
    return (newest.p_m.z() - from.p_m.z()) / over_s;
  }
};

TEST(VelocityWindow, ExactEncodersOnTimeTakeTheLastState) {
  Motion motion([](double t_s) { return std::sin(30 * t_s); });
  for (int i = 0; i < 100; ++i) {
    motion.at(i * kPeriod_s);
    EXPECT_EQ(motion.window.begin(0, kPeriod_s).ago_s, 0) << i;
  }
}

TEST(VelocityWindow, ASteadyMotionHasTheErrorOfACountOverTheWholeWindow) {
  for (const double speed : {0.0, 0.01, 0.3, 1.0, -2.0}) {
    Motion motion([&](double t_s) { return speed * t_s; }, kCount_rad);
    std::mt19937_64 random(7);
    double t_s = 0, largest = 0, ago_s = 0;
    for (int i = 0; i < 500; ++i) {
      t_s += kPeriod_s * (0.25 + static_cast<double>(random() % 8) / 4);
      motion.at(t_s);
      if (i <= kVelocitySamples) continue;
      largest = std::max(largest, std::abs(motion.velocity() - 0.1 * speed));
      ago_s = motion.window.begin(kCount_rad, kPeriod_s).ago_s;
      ASSERT_LE(std::abs(motion.velocity() - 0.1 * speed), 0.1 * kCount_rad / ago_s * (1 + 1e-6));
    }
    EXPECT_GT(ago_s, 0.7 * kVelocitySamples * 1.125 * kPeriod_s) << "the whole window";
    EXPECT_LT(largest, 0.1 * kCount_rad / (0.5 * kVelocitySamples * kPeriod_s));
  }
}

// A difference over one period has an error of up to a count in it: 31 mm/s here.
TEST(VelocityWindow, AnAcceleratingMotionLagsByWhatTheEncodersCannotTell) {
  for (const double acceleration : {5.0, 20.0, 80.0}) {  // rad/s^2; 0.5 to 8 m/s^2
    Motion motion([&](double t_s) { return acceleration * t_s * t_s / 2; }, kCount_rad);
    double largest = 0;
    for (int i = 0; i < 300; ++i) {
      motion.at(i * kPeriod_s);
      if (i < 50) continue;
      largest = std::max(largest, std::abs(motion.velocity() - 0.1 * acceleration * i * kPeriod_s));
    }
    // A line leaves a parabola by a T^2 / 8: with a band of one count, and half a count of each
    // reading, that is at most two counts. The lag is a T / 2, and the ends' error a count over T.
    const double window_s = std::sqrt(16 * kCount_rad / acceleration) + kPeriod_s;
    EXPECT_LE(largest, 0.1 * (acceleration * window_s / 2 + 2 * kCount_rad / window_s))
        << acceleration;
    EXPECT_LT(largest, 0.1 * kCount_rad / kPeriod_s) << "less than without a window";
  }
}

TEST(VelocityWindow, ATurnEndsTheWindow) {
  Motion motion([](double t_s) { return -std::abs(t_s - 0.1); }, kCount_rad);
  for (int i = 0; i <= 110; ++i)
    motion.at(i * kPeriod_s);
  EXPECT_NEAR(motion.velocity(), -0.1, 0.005) << "10 ms after a turn, as before it";
  EXPECT_LE(motion.window.begin(kCount_rad, kPeriod_s).ago_s, 10.5 * kPeriod_s);
}

TEST(VelocityWindow, ALateStateHasTheVelocityOfOneOnTime) {
  // At constant acceleration the result is the velocity half a period earlier, whatever the intervals.
  Motion motion([](double t_s) { return 40 * t_s * t_s; });
  std::mt19937_64 random(3);
  double t_s = 0;
  for (int i = 0; i < 200; ++i) {
    const double interval_s = kPeriod_s * (1.25 + static_cast<double>(random() % 20) / 4);
    t_s += interval_s;
    motion.at(t_s);
    if (i < 3) continue;
    EXPECT_NEAR(motion.velocity(), 8 * (t_s - kPeriod_s / 2), 1e-9) << i;
  }
}

// Before a late state, an interval of a fifth of a tick: the time stamps are off, and an
// extrapolation over it would turn the velocity round.
TEST(VelocityWindow, AShortIntervalIsNotExtrapolated) {
  for (const double before_s : {0.2e-3, 0.3e-3, 0.49e-3}) {
    Motion motion([](double t_s) { return t_s; });
    for (int i = 0; i < 5; ++i)
      motion.at(i * kPeriod_s);
    // The true motion is one period from state to state.
    Pose pose = motion.newest;
    for (const double stamp_s : {4e-3 + before_s, 6e-3}) {
      pose.p_m.z() += 1e-4;
      motion.window.add({stamp_s, 0, {}}, pose);
    }
    EXPECT_EQ(motion.window.begin(0, kPeriod_s).ago_s, 0) << before_s;
  }
}

TEST(VelocityWindow, ClearedItHasNoMotion) {
  Motion motion([](double t_s) { return t_s; }, kCount_rad);
  for (int i = 0; i < 20; ++i)
    motion.at(i * kPeriod_s);
  ASSERT_GT(motion.window.begin(kCount_rad, kPeriod_s).ago_s, 0);
  motion.window.clear();
  EXPECT_EQ(motion.window.begin(kCount_rad, kPeriod_s).ago_s, 0);
  motion.at(1);
  motion.at(1 + 5 * kPeriod_s);
  EXPECT_EQ(motion.window.begin(kCount_rad, kPeriod_s).ago_s, 0);
}

}  // namespace
}  // namespace trocar::runtime
