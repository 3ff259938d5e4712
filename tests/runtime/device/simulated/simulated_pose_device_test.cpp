// SPDX-License-Identifier: Apache-2.0
// The simulated pose device against exact solutions.
#include "runtime/device/simulated/simulated_device.h"

#include <gtest/gtest.h>

#include <cmath>

namespace trocar::runtime {
namespace {

PoseDeviceDescription simulated_arm(bool senses_rotation = false) {
  PoseDeviceDescription device;
  device.force_max_N = 10;
  device.mass_kg = 0.4;
  device.damping_N_s_per_m = 2;
  device.senses_rotation = senses_rotation;
  device.inertia_kg_m2 = {1e-3, 1e-3, 1e-3};
  device.workspace_min_m = {-0.1, -0.1, -0.1};
  device.workspace_max_m = {0.1, 0.1, 0.1};
  return device;
}

HandTrajectory at_rest() {
  HandTrajectory path;
  path.keyframes = {{0, Pose{}}};
  return path;
}

Result<SimulatedPoseDevice> make(const PoseDeviceDescription& device, const HandMotion& motion,
                                 const HandImpedance& impedance) {
  return SimulatedPoseDevice::make(device, PoseFrame(device, Pose{}), motion, impedance, Pose{});
}

TEST(SimulatedPoseDevice, OscillatesLikeADampedSpring) {
  HandImpedance hand;
  hand.stiffness_N_per_m = 500;
  hand.damping_Ns_per_m = 2;
  auto made = make(simulated_arm(), at_rest(), hand);
  ASSERT_TRUE(made);
  made->write({3, 0, 0, 0, 0, 0});
  const double m = 0.4, d = 4, k = 500, decay = d / (2 * m),
               rate = std::sqrt(k / m - decay * decay);
  double worst_m = 0;
  for (int i = 1; i <= 500; ++i) {
    made->advance(1e-3);
    const double t = i * 1e-3;
    const double exact =
        3 / k *
        (1 - std::exp(-decay * t) * (std::cos(rate * t) + decay / rate * std::sin(rate * t)));
    PoseReading reading;
    made->read(reading);
    worst_m = std::max(worst_m, std::abs(reading.p_m[0] - exact));
  }
  EXPECT_LT(worst_m, 0.01 * 3 / k);
}

TEST(SimulatedPoseDevice, WithoutAHandTheOwnDampingLimitsTheSpeed) {
  HandImpedance lets_go;
  lets_go.let_go_t_s = 0;
  auto made = make(simulated_arm(), at_rest(), lets_go);
  ASSERT_TRUE(made);
  made->write({0, 0, 1, 0, 0, 0});
  for (int i = 0; i < 5000; ++i)
    made->advance(1e-3);
  EXPECT_NEAR(made->twist_device()[2], 1.0 / 2, 1e-6);
}

TEST(SimulatedPoseDevice, MomentTurnsAHandleThatCanTurnOnly) {
  for (const bool turns : {false, true}) {
    auto made = make(simulated_arm(turns), at_rest(), {});
    ASSERT_TRUE(made);
    made->write({0, 0, 0, 0.2, 0, 0});
    for (int i = 0; i < 2000; ++i)
      made->advance(1e-3);
    const double angle_rad = rotation_vector(made->T_device_plate().q).x();
    EXPECT_NEAR(angle_rad, turns ? 0.2 / HandImpedance{}.rotational_stiffness_Nm_per_rad : 0, 1e-6);
  }
}

TEST(SimulatedPoseDevice, StaysFiniteForAnyMassAndCommand) {
  PoseDeviceDescription light = simulated_arm(true);
  light.mass_kg = 1e-3;
  light.inertia_kg_m2 = {1e-8, 1e-8, 1e-8};
  auto made = make(light, at_rest(), stiff_grip());
  ASSERT_TRUE(made);
  made->write({NAN, 0, 0, 0, 0, 0});
  made->advance(1e-3);
  EXPECT_EQ(made->twist_device().norm(), 0);
  made->write({5, -3, 8, 0.1, 0.1, -0.1});
  for (int i = 0; i < 1000; ++i)
    made->advance(1e-3);
  EXPECT_NEAR(made->T_device_plate().p_m.x(), 5 / stiff_grip().stiffness_N_per_m, 1e-5);
  made->advance(-1);
  made->advance(NAN);
  made->advance(100);
  EXPECT_TRUE(is_finite(made->T_device_plate()));
}

TEST(SimulatedPoseDevice, StatesWholeCounts) {
  PoseDeviceDescription device = simulated_arm(true);
  device.position_resolution_m = 1e-4;
  device.rotation_resolution_rad = 1e-2;
  HandTrajectory path = at_rest();
  path.keyframes.push_back({1, {{0.0333333, 0, 0}, from_rotation_vector({0, 0.3, 0})}});
  auto made = make(device, path, {});
  ASSERT_TRUE(made);
  for (int i = 0; i < 900; ++i)
    made->advance(1e-3);
  PoseReading reading;
  made->read(reading);
  EXPECT_NEAR(std::remainder(reading.p_m[0], 1e-4), 0, 1e-12);
  EXPECT_NEAR(
      std::hypot(std::hypot(reading.q[0], reading.q[1]), std::hypot(reading.q[2], reading.q[3])), 1,
      1e-12);
}

TEST(SimulatedPoseDevice, WrongHandIsRefused) {
  HandImpedance wrong;
  wrong.stiffness_N_per_m = -1;
  EXPECT_FALSE(make(simulated_arm(), at_rest(), wrong));
}

}  // namespace
}  // namespace trocar::runtime
