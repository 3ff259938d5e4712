// SPDX-License-Identifier: Apache-2.0
#include "runtime/device/simulated/simulated_device.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "runtime/device/four_legs/kinematics.h"
#include "runtime/device/four_legs/torque_allocation.h"
#include "tests/support/device_workspace.h"

namespace trocar::runtime {
namespace {

using Eigen::Vector3d;

constexpr HandImpedance kNoHandForce = {0, 0, 0, 0};

HandKeyframe keyframe(double t_s, double z_m) {
  HandKeyframe k;
  k.t_s = t_s;
  k.T_device_tool.p_m.z() = z_m;
  return k;
}

SimulatedDevice make(const DeviceDescription& device, const HandTrajectory& hand,
                     const HandImpedance& impedance = {}, const SimulatedDeviceOptions& o = {}) {
  auto made = SimulatedDevice::make(device, hand, impedance, o);
  EXPECT_TRUE(made);
  return *made;
}

// The torques for a wanted wrench at the plate's origin, as in the loop.
DeviceCommand command_for(const DeviceDescription& device, const Pose& T, const Wrench& wrench) {
  const InverseResult inverse = inverse_kinematics(device, T);
  const AllocationResult allocated =
      allocate_torques(jacobian(device, T, inverse.joints).G, wrench, device.motor_peak_torque_Nm);
  DeviceCommand command;
  for (int i = 0; i < kMotors; ++i)
    command.tau_motor_Nm[i] = allocated.tau_motor_Nm[i];
  return command;
}

// x(t) of m x'' + c x' + k x = 0 from x(0) = x0 at rest, underdamped.
double damped_oscillation(double m, double c, double k, double x0, double t) {
  const double decay = c / (2 * m), omega = std::sqrt(k / m - decay * decay);
  return x0 * std::exp(-decay * t) * (std::cos(omega * t) + decay / omega * std::sin(omega * t));
}

// Largest deviation from the exact solution over 50 ms.
double oscillation_error(bool rotation, double substep_s) {
  DeviceDescription device = default_device_description();
  device.joint_viscous_friction_Nms_per_rad = 0;
  device.maximum_substep_s = substep_s;
  const HandImpedance impedance = {4000, 20, 20, 0.05};
  HandTrajectory hand;
  hand.keyframes = {keyframe(0, 0.15)};
  SimulatedDeviceOptions options;
  options.T_device_plate_start = Pose{};
  options.T_device_plate_start->p_m.z() = 0.15;
  const double start = rotation ? 0.1 : 0.004;
  if (rotation) {
    options.T_device_plate_start->q = from_rotation_vector({0, 0, start});
  } else {
    options.T_device_plate_start->p_m.y() = start;
  }
  SimulatedDevice simulated = make(device, hand, impedance, options);
  double worst = 0;
  for (int tick = 1; tick <= 50; ++tick) {
    EXPECT_TRUE(simulated.step(1e-3));
    const double t = tick * 1e-3;
    const Pose& T = simulated.truth().T_device_plate;
    const double expected =
        rotation ? damped_oscillation(device.plate_inertia_kg_m2[2], 0.05, 20, start, t)
                 : damped_oscillation(device.plate_mass_kg, 20, 4000, start, t);
    const double actual = rotation ? rotation_vector(T.q).z() : T.p_m.y();
    worst = std::max(worst, std::abs(actual - expected));
  }
  return worst / start;
}

TEST(SimulatedDevice, FollowsTheExactOscillationToFirstOrder) {
  for (const bool rotation : {false, true}) {
    const double coarse = oscillation_error(rotation, 1e-4);
    const double fine = oscillation_error(rotation, 1e-5);
    EXPECT_LT(coarse, 0.02);
    EXPECT_NEAR(coarse / fine, 10, 2) << "semi-implicit Euler is of first order";
  }
}

// Signs and frames of the whole chain: a wanted force on the tip, given by torques, moves a held
// tool by force over stiffness without rotating it.
TEST(SimulatedDevice, AHeldToolMovesByForceOverStiffness) {
  const DeviceDescription device = default_device_description();
  const HandImpedance impedance;
  for (const Vector3d& force : {Vector3d(0, 0, 20), Vector3d(12, 0, 0), Vector3d(-5, 9, -15)}) {
    HandTrajectory hand;
    hand.keyframes = {keyframe(0, 0.17)};
    SimulatedDeviceOptions options;
    options.T_plate_tool.p_m = {0.004, -0.003, 0.03};
    SimulatedDevice simulated = make(device, hand, impedance, options);
    for (int tick = 0; tick < 1500; ++tick) {
      const Pose& T = simulated.truth().T_device_plate;
      Wrench at_tip = Wrench::Zero();
      at_tip.head<3>() = force;
      const Wrench wanted = moved_by(at_tip, T.q * options.T_plate_tool.p_m);
      simulated.write(command_for(device, T, wanted));
      ASSERT_TRUE(simulated.step(1e-3));
    }
    const Pose tool = simulated.truth().T_device_plate * options.T_plate_tool;
    EXPECT_LT((tool.p_m - Vector3d(0, 0, 0.17) - force / impedance.stiffness_N_per_m).norm(), 1e-8);
    EXPECT_LT(rotation_vector(tool.q).norm(), 1e-7);
    EXPECT_LT((Vector3d(simulated.truth().wrench_hand.head<3>()) + force).norm(), 1e-5);
  }
}

TEST(SimulatedDevice, GravityIsOffByDefaultAndActsDownwards) {
  DeviceDescription device = default_device_description();
  SimulatedDevice balanced = make(device, {});
  device.gravity_m_per_s2 = 9.81;
  device.joint_viscous_friction_Nms_per_rad = 0;
  SimulatedDevice falling = make(device, {});
  for (int tick = 0; tick < 50; ++tick) {
    ASSERT_TRUE(balanced.step(1e-3));
    ASSERT_TRUE(falling.step(1e-3));
  }
  EXPECT_EQ(balanced.truth().T_device_plate.p_m, Vector3d(0, 0, kSimulatedHomeHeight_m));
  EXPECT_NEAR(falling.truth().T_device_plate.p_m.z(),
              kSimulatedHomeHeight_m - 0.5 * 9.81 * 0.05 * 0.05, 5e-5);
}

TEST(SimulatedDevice, EnergyBalanceCloses) {
  const auto imbalance = [](double substep_s, bool rotate) {
    DeviceDescription device = default_device_description();
    device.maximum_substep_s = substep_s;
    HandTrajectory hand;
    hand.interpolation = HandInterpolation::kMinimumJerk;
    hand.keyframes = {keyframe(0, 0.16), keyframe(0.15, 0.13), keyframe(0.3, 0.17)};
    if (rotate) hand.keyframes[1].T_device_tool.q = from_rotation_vector({0.08, -0.05, 0.1});
    SimulatedDevice simulated = make(device, hand);
    double most_kinetic = 0;
    for (int tick = 0; tick < 300; ++tick) {
      const Pose& T = simulated.truth().T_device_plate;
      Wrench push = Wrench::Zero();
      push[2] = T.p_m.z() < 0.14 ? 3000 * (0.14 - T.p_m.z()) : 0;
      simulated.write(command_for(device, T, push));
      EXPECT_TRUE(simulated.step(1e-3));
      most_kinetic = std::max(most_kinetic, simulated.truth().kinetic_J);
    }
    const EnergyBalance& work = simulated.truth().work;
    EXPECT_LT(work.friction_J, 0);
    EXPECT_GT(most_kinetic, 0.01);
    EXPECT_EQ(work.stop_J, 0);
    return std::abs(work.hand_J + work.motors_J + work.friction_J + work.gravity_J + work.stop_J -
                    simulated.truth().kinetic_J);
  };
  // Different friction of the legs rotates the plate slightly even in straight motion.
  EXPECT_LT(imbalance(1e-4, false), 1e-9);
  const double coarse = imbalance(1e-4, true), fine = imbalance(1e-5, true);
  EXPECT_LT(coarse, 1e-5);
  EXPECT_LT(fine, coarse / 5);
}

TEST(SimulatedDevice, EncodersAreThoseOfTheTruePoseQuantised) {
  DeviceDescription device = default_device_description();
  testing_support::Random random(31);
  for (const int counts : {0, 4096, 400'000}) {
    device.encoder_counts_per_revolution = counts;
    for (int n = 0; n < 50; ++n) {
      SimulatedDeviceOptions options;
      options.T_device_plate_start = testing_support::random_workspace_pose(random);
      SimulatedDevice simulated = make(device, {}, kNoHandForce, options);
      DeviceState state;
      ASSERT_EQ(simulated.read(state), DeviceStatus::kOk);
      const auto exact =
          encoder_angles(inverse_kinematics(device, *options.T_device_plate_start).joints);
      for (int i = 0; i < kEncoders; ++i) {
        if (counts == 0) {
          EXPECT_EQ(state.encoder_rad[i], exact[i]);
          continue;
        }
        const double count_rad = 2 * std::numbers::pi / counts;
        const double in_counts = state.encoder_rad[i] / count_rad;
        EXPECT_NEAR(in_counts, std::round(in_counts), 1e-6);
        EXPECT_LE(std::abs(state.encoder_rad[i] - exact[i]), 0.5 * count_rad * (1 + 1e-9));
      }
    }
  }
}

TEST(SimulatedDevice, ClipsLargeTorquesAndRefusesNonFiniteOnes) {
  const DeviceDescription device = default_device_description();
  SimulatedDevice simulated = make(device, {});
  DeviceCommand command;
  command.tau_motor_Nm = {1, -2, 3, -4, 5, -5.5, 5.9, -6};
  simulated.write(command);
  for (int i = 0; i < kMotors; ++i) {
    EXPECT_EQ(simulated.truth().tau_motor_Nm[i], command.tau_motor_Nm[i]);
  }
  command.tau_motor_Nm = {7, -7, 6.0001, -1e9, 1, 2, 3, 4};
  simulated.write(command);
  MotorVector clipped;
  clipped << 6, -6, 6, -6, 1, 2, 3, 4;
  EXPECT_EQ(simulated.truth().tau_motor_Nm, clipped);
  command.tau_motor_Nm[5] = std::numeric_limits<double>::quiet_NaN();
  simulated.write(command);
  EXPECT_EQ(simulated.truth().tau_motor_Nm, MotorVector::Zero());

  for (const double dt : {0.0, -1e-3, 1.0, std::numeric_limits<double>::quiet_NaN(),
                          std::numeric_limits<double>::infinity()}) {
    EXPECT_FALSE(simulated.step(dt));
  }
  EXPECT_EQ(simulated.truth().t_s, 0);
}

TEST(SimulatedDevice, StopsAtTheEndOfReach) {
  const DeviceDescription device = default_device_description();
  SimulatedDevice simulated = make(device, {});
  bool stopped = false;
  for (int tick = 0; tick < 2000; ++tick) {
    simulated.write({{6, 6, 6, -6, 6, 6, 6, -6}});
    ASSERT_TRUE(simulated.step(1e-3));
    stopped = stopped || simulated.truth().at_stop;
    DeviceState state;
    simulated.read(state);
    for (const double angle : state.encoder_rad)
      ASSERT_TRUE(std::isfinite(angle));
    ASSERT_TRUE(is_finite(simulated.truth().T_device_plate));
  }
  EXPECT_TRUE(stopped);
  const EnergyBalance& work = simulated.truth().work;
  EXPECT_LT(work.stop_J, 0);
}

// A hand of any damping that a scene may state pulls a deflected tool to its target. In the light
// model, the described step of 0.1 ms is stable only below 8 N m s/rad and 7000 N s/m.
TEST(SimulatedDevice, StronglyDampedHandsAreStable) {
  HandTrajectory hand;
  hand.keyframes = {keyframe(0, 0.25)};
  SimulatedDeviceOptions options;
  options.T_plate_tool.p_m = {0, 0, 0.1};
  options.T_device_plate_start = Pose{};
  options.T_device_plate_start->p_m.z() = 0.15;
  options.T_device_plate_start->q = from_rotation_vector({0.01, 0, 0});
  const auto rotation_after = [&](const HandImpedance& impedance, double substep_s) {
    DeviceDescription device = default_device_description();
    device.maximum_substep_s = substep_s;
    SimulatedDevice simulated = make(device, hand, impedance, options);
    for (int tick = 0; tick < 50; ++tick) {
      EXPECT_TRUE(simulated.step(1e-3));
      EXPECT_FALSE(simulated.truth().at_stop);
      EXPECT_LT(simulated.truth().kinetic_J, 0.01) << tick;
    }
    return rotation_vector(simulated.truth().T_device_plate.q).x();
  };
  for (const double mass_kg : {0.0, 0.5}) {
    for (const double rotation_Nms_per_rad : {0.3, 7.0, 9.0, 50.0}) {
      const HandImpedance impedance{500, 2, 20, rotation_Nms_per_rad, mass_kg};
      const double exact = rotation_after(impedance, 1e-6);
      EXPECT_NEAR(rotation_after(impedance, 1e-4), exact, 0.02 * 0.01) << rotation_Nms_per_rad;
    }
    rotation_after({500, 10'000, 20, 1000, mass_kg}, 1e-4);
  }
}

TEST(Hand, TrajectoryPassesItsKeyframesAndTheTwistIsItsDerivative) {
  HandTrajectory hand;
  hand.keyframes = {keyframe(1, 0.2), keyframe(2, 0.15), keyframe(4, 0.16)};
  hand.keyframes[1].T_device_tool.q = from_rotation_vector({0.3, -0.2, 0.1});
  hand.keyframes[2].T_device_tool.q = from_rotation_vector({-0.1, 0.4, 0.2});
  for (const auto how : {HandInterpolation::kLinear, HandInterpolation::kMinimumJerk}) {
    hand.interpolation = how;
    for (const HandKeyframe& k : hand.keyframes) {
      const HandTarget at = hand_target(hand, k.t_s);
      EXPECT_LT((at.T_device_tool.p_m - k.T_device_tool.p_m).norm(), 1e-15);
      EXPECT_LT(at.T_device_tool.q.angularDistance(k.T_device_tool.q), 1e-7);
    }
    EXPECT_EQ(hand_target(hand, -5).twist_device, Twist::Zero());
    EXPECT_EQ(hand_target(hand, 9).twist_device, Twist::Zero());
    EXPECT_EQ(hand_target(hand, 9).T_device_tool.p_m.z(), 0.16);
    for (const double t : {1.1, 1.5, 1.93, 2.2, 3.7}) {
      constexpr double kStep = 1e-6;
      const HandTarget before = hand_target(hand, t - kStep), after = hand_target(hand, t + kStep);
      Twist difference;
      difference << (after.T_device_tool.p_m - before.T_device_tool.p_m) / (2 * kStep),
          rotation_vector(after.T_device_tool.q * before.T_device_tool.q.conjugate()) / (2 * kStep);
      EXPECT_LT((difference - hand_target(hand, t).twist_device).norm(), 1e-8);
    }
  }
}

// The simulated pose device against exact solutions.

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
  auto made = make(light, at_rest(), kStiffGrip);
  ASSERT_TRUE(made);
  made->write({NAN, 0, 0, 0, 0, 0});
  made->advance(1e-3);
  EXPECT_EQ(made->twist_device().norm(), 0);
  made->write({5, -3, 8, 0.1, 0.1, -0.1});
  for (int i = 0; i < 1000; ++i)
    made->advance(1e-3);
  EXPECT_NEAR(made->T_device_plate().p_m.x(), 5 / kStiffGrip.stiffness_N_per_m, 1e-5);
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

}  // namespace
}  // namespace trocar::runtime
