// SPDX-License-Identifier: Apache-2.0
// The equation of motion compared with masses and accelerations from differences of positions; the
// energy balance of the full model; friction, lag, noise and the hand, one by one.
#include "runtime/device/simulated/mechanics.h"
#include "runtime/device/simulated/hand.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <vector>

#include "runtime/device/four_legs/kinematics.h"
#include "runtime/device/simulated/simulated_device.h"
#include "tests/support/device_workspace.h"

namespace trocar::runtime {
namespace {

using Eigen::Vector3d;
using testing_support::Random;

constexpr MechanicsOptions kHeavy = {{0.3, 0.25, 0.2, 0.35}, 4e-4, 0, 5e-4, 1e-3, 0, 0, 1};

HandTrajectory rest_at(double z_m) {
  HandTrajectory hand;
  hand.keyframes.resize(1);
  hand.keyframes[0].T_device_tool.p_m.z() = z_m;
  return hand;
}

/// All masses at a pose, from the inverse kinematics: points (mass, position) and motor angles.
struct Body {
  std::vector<double> mass_kg;
  std::vector<Vector3d> place_m;
  MotorVector motor_rad;
};
Body body_at(const DeviceDescription& device, const MechanicsOptions& options, const Pose& T,
             double tip_mass_kg, const Vector3d& tip_plate_m) {
  Body body;
  const InverseResult inverse = inverse_kinematics(device, T);
  EXPECT_TRUE(inverse.status);
  const DeviceGeometry& g = device.geometry;
  const auto add = [&](double mass, int m, const Vector3d& place_leg) {
    body.mass_kg.push_back(mass);
    body.place_m.push_back(leg::from_leg(m, place_leg));
  };
  const auto& mass = options.link_mass_kg;
  for (int m = 0; m < kLegs; ++m) {
    const auto& th = inverse.joints.theta_rad[m];
    const Vector3d E = leg::elbow(g, th[0]), C = leg::upper_tip(g, th[0], th[1], th[2]);
    add((mass[0] + mass[1]) / 2, m, E);
    add(mass[1] / 2, m, C);
    add((mass[2] + mass[3]) / 2, m, leg::lower_elbow(g, th[3]));
    add(mass[3] / 2, m, leg::link_joint(g, E, C));
  }
  // Six points on the axes that have the principal moments of the plate.
  const auto& I = device.plate_inertia_kg_m2;
  const double second[3] = {(I[1] + I[2] - I[0]) / 2, (I[0] + I[2] - I[1]) / 2,
                            (I[0] + I[1] - I[2]) / 2};
  for (int axis = 0; axis < 3; ++axis) {
    const double arm = std::sqrt(3 * second[axis] / device.plate_mass_kg);
    for (const double sign : {-1.0, 1.0}) {
      body.mass_kg.push_back(device.plate_mass_kg / 6);
      body.place_m.push_back(T * Vector3d(sign * arm * Vector3d::Unit(axis)));
    }
  }
  body.mass_kg.push_back(tip_mass_kg);
  body.place_m.push_back(T * tip_plate_m);
  body.motor_rad = motor_angles(inverse.joints);
  return body;
}

Pose moved(const Pose& T, const Twist& twist, double t) {
  return {T.p_m + t * twist.head<3>(),
          (from_rotation_vector(t * twist.tail<3>()) * T.q).normalized()};
}

TEST(Mechanics, MassBiasAndWeightAgreeWithDifferencesOfPoints) {
  DeviceDescription device = default_device_description();
  device.gravity_m_per_s2 = 9.81;
  Random random(3);
  double worst_mass = 0, worst_bias = 0, worst_weight = 0;
  for (int n = 0; n < 200; ++n) {
    const Pose T = testing_support::random_workspace_pose(random);
    Twist V;
    V << 0.5 * random.in_ball(), 5 * random.in_ball();
    const double tip_mass = 0.2;
    const Vector3d tip(0.01, -0.02, 0.05);
    const auto at = [&](const Pose& pose) { return body_at(device, kHeavy, pose, tip_mass, tip); };

    // Jacobians of all points and motors by central differences, then M, then h from the second
    // differences along the twist.
    constexpr double kStep = 1e-5, kTime = 2e-5;
    const Body here = at(T), ahead = at(moved(T, V, kTime)), behind = at(moved(T, V, -kTime));
    std::vector<Body> plus, minus;
    for (int i = 0; i < 6; ++i) {
      plus.push_back(at(moved(T, Twist::Unit(i), kStep)));
      minus.push_back(at(moved(T, Twist::Unit(i), -kStep)));
    }
    MassMatrix mass = MassMatrix::Zero();
    Wrench bias = Wrench::Zero(), weight = Wrench::Zero();
    for (std::size_t p = 0; p < here.mass_kg.size(); ++p) {
      Eigen::Matrix<double, 3, 6> J;
      for (int i = 0; i < 6; ++i)
        J.col(i) = (plus[i].place_m[p] - minus[i].place_m[p]) / (2 * kStep);
      const Vector3d a =
          (ahead.place_m[p] - 2 * here.place_m[p] + behind.place_m[p]) / (kTime * kTime);
      mass += here.mass_kg[p] * J.transpose() * J;
      bias += here.mass_kg[p] * J.transpose() * a;
      if (p + 1 < here.mass_kg.size()) {  // the hand's mass has no weight
        weight += here.mass_kg[p] * J.transpose() * Vector3d(0, 0, -9.81);
      }
    }
    Jacobian G;
    for (int i = 0; i < 6; ++i)
      G.col(i) = (plus[i].motor_rad - minus[i].motor_rad) / (2 * kStep);
    const MotorVector a =
        (ahead.motor_rad - 2 * here.motor_rad + behind.motor_rad) / (kTime * kTime);
    mass += kHeavy.rotor_inertia_kg_m2 * G.transpose() * G;
    bias += kHeavy.rotor_inertia_kg_m2 * G.transpose() * a;

    const Mechanics got =
        mechanics(device, kHeavy, T, inverse_kinematics(device, T).joints, V, tip_mass, T.q * tip);
    ASSERT_TRUE(got.status);
    worst_mass = std::max(worst_mass, (got.mass - mass).norm() / mass.norm());
    worst_bias = std::max(worst_bias, (got.bias - bias).norm() / bias.norm());
    worst_weight = std::max(worst_weight, (got.weight - weight).norm() / weight.norm());
    EXPECT_LT((got.mass - got.mass.transpose()).norm(), 1e-15 * got.mass.norm());
    EXPECT_TRUE(got.mass.ldlt().isPositive());
  }
  EXPECT_LT(worst_mass, 1e-7);
  EXPECT_LT(worst_bias, 1e-4);  // second differences: rounding over the squared time
  EXPECT_LT(worst_weight, 1e-7);
}

SimulatedDevice make(const DeviceDescription& device, const MechanicsOptions& mechanics,
                     const HandTrajectory& hand, const HandImpedance& impedance,
                     const std::optional<Pose>& start = std::nullopt) {
  SimulatedDeviceOptions options;
  options.mechanics = mechanics;
  options.T_device_plate_start = start;
  options.T_plate_tool.p_m = {0, 0, 0.02};
  auto made = SimulatedDevice::make(device, hand, impedance, options);
  EXPECT_TRUE(made) << made.error().message;
  return std::move(*made);
}

// All effects together: motors, gravity, both kinds of friction, lag, and a hand with mass that
// turns the tool and releases it. The imbalance falls with the square of the substep.
TEST(Mechanics, EnergyBalanceClosesToSecondOrder) {
  const auto imbalance = [](double substep_s) {
    DeviceDescription device = default_device_description();
    device.gravity_m_per_s2 = 9.81;
    device.maximum_substep_s = substep_s;
    HandTrajectory hand = rest_at(0.16);
    hand.interpolation = HandInterpolation::kMinimumJerk;
    hand.keyframes.resize(3);
    hand.keyframes[1] = {0.15, {{0.01, 0, 0.13}, from_rotation_vector({0.08, -0.05, 0.1})}};
    hand.keyframes[2] = {0.3, {{0, 0.005, 0.17}, Eigen::Quaterniond::Identity()}};
    MechanicsOptions mechanics = kHeavy;
    mechanics.coulomb_friction_Nm = 0.02;
    mechanics.presliding_rad = 5e-3;
    mechanics.current_lag_s = 1e-3;
    HandImpedance impedance;
    impedance.mass_kg = 0.3;
    impedance.let_go_t_s = 0.25;
    SimulatedDevice simulated = make(device, mechanics, hand, impedance);
    double most = 0;
    for (int tick = 0; tick < 300; ++tick) {
      const double wave = std::sin(0.1 * tick);
      simulated.write({{0.3 * wave, -0.2, 0.3 * wave, 0.2, 0.3 * wave, -0.1, 0.3 * wave, 0.1}});
      EXPECT_TRUE(simulated.step(1e-3));
      most = std::max(most, simulated.truth().kinetic_J);
    }
    const EnergyBalance& work = simulated.truth().work;
    EXPECT_LT(work.friction_J, -1e-3);
    EXPECT_GT(std::abs(work.motors_J), 1e-3);
    EXPECT_NE(work.hand_J, 0);
    EXPECT_EQ(work.stop_J, 0) << "reached the end of reach";
    EXPECT_GT(most, 0.02);
    return std::abs(work.hand_J + work.motors_J + work.friction_J + work.gravity_J -
                    simulated.truth().kinetic_J) /
           most;
  };
  const double coarse = imbalance(1e-4), fine = imbalance(2.5e-5);
  EXPECT_LT(coarse, 1e-4);
  EXPECT_LT(fine, coarse / 8);
}

TEST(Mechanics, WithoutExtraMassesItAgreesWithTheLightModel) {
  const DeviceDescription device = default_device_description();
  HandTrajectory hand = rest_at(0.15);
  hand.keyframes.resize(2);
  hand.keyframes[1] = {0.2, {{0.005, 0, 0.12}, from_rotation_vector({0.05, 0, -0.05})}};
  SimulatedDeviceOptions light;
  light.T_plate_tool.p_m = {0, 0, 0.02};
  auto a = SimulatedDevice::make(device, hand, {}, light);
  ASSERT_TRUE(a);
  SimulatedDevice b = make(device, MechanicsOptions::none(), hand, {});
  for (int tick = 0; tick < 300; ++tick) {
    for (SimulatedDevice* simulated : {&*a, &b}) {
      simulated->write({{0.5, -0.5, 0.2, 0.1, 0, 0.3, 0, 0.125}});
      ASSERT_TRUE(simulated->step(1e-3));
    }
    const double apart_m = (a->truth().T_device_plate.p_m - b.truth().T_device_plate.p_m).norm();
    ASSERT_LT(apart_m, 2e-5) << "tick " << tick;
  }
}

// Below the Coulomb torque the device moves by the presliding deflection and stops; above it, it
// slides.
TEST(Mechanics, DryFrictionHoldsUpToTheCoulombTorque) {
  const DeviceDescription device = default_device_description();
  MechanicsOptions options = MechanicsOptions::none();
  options.coulomb_friction_Nm = 0.05;
  for (const double torque_Nm : {0.03, 0.12}) {
    SimulatedDevice simulated = make(device, options, {}, {});
    const double start_rad = motor_angles(simulated.truth().joints)[0];
    simulated.write({{torque_Nm, 0, torque_Nm, 0, torque_Nm, 0, torque_Nm, 0}});
    for (int tick = 0; tick < 400; ++tick)
      ASSERT_TRUE(simulated.step(1e-3));
    const double moved_rad = std::abs(motor_angles(simulated.truth().joints)[0] - start_rad);
    if (torque_Nm < options.coulomb_friction_Nm) {
      EXPECT_LE(moved_rad, options.presliding_rad);
      EXPECT_GT(moved_rad, 0);
      EXPECT_LT(simulated.truth().twist_device.norm(), 1e-4);
    } else {
      EXPECT_GT(moved_rad, 20 * options.presliding_rad);
    }
  }
}

TEST(Mechanics, TorqueFollowsItsCommandWithTheLag) {
  const DeviceDescription device = default_device_description();
  MechanicsOptions options = MechanicsOptions::none();
  options.current_lag_s = 2e-3;
  HandImpedance firm;
  SimulatedDevice simulated = make(device, options, rest_at(0.15), firm);
  simulated.write({{1, -2, 0, 0, 0, 0, 0, 0}});
  for (int tick = 1; tick <= 20; ++tick) {
    ASSERT_TRUE(simulated.step(1e-3));
    const double share = 1 - std::exp(-tick * 1e-3 / 2e-3);
    EXPECT_NEAR(simulated.truth().tau_applied_Nm[0], share, 1e-12);
    EXPECT_NEAR(simulated.truth().tau_applied_Nm[1], -2 * share, 1e-12);
    EXPECT_EQ(simulated.truth().tau_motor_Nm[0], 1);
  }
}

TEST(Mechanics, EncoderNoiseHasTheGivenDeviationAndSeed) {
  const DeviceDescription device = default_device_description();
  MechanicsOptions options = MechanicsOptions::none();
  options.encoder_noise_rad = 1e-4;
  const auto readings = [&](std::uint64_t seed) {
    options.seed = seed;
    SimulatedDevice simulated = make(device, options, {}, {});
    std::vector<double> all;
    for (int n = 0; n < 4000; ++n) {
      DeviceState state;
      simulated.read(state);
      for (int i = 0; i < kEncoders; ++i)
        all.push_back(state.encoder_rad[i] - encoder_angles(simulated.truth().joints)[i]);
    }
    return all;
  };
  const std::vector<double> once = readings(7), again = readings(7), other = readings(8);
  EXPECT_EQ(std::memcmp(once.data(), again.data(), once.size() * sizeof(double)), 0);
  EXPECT_NE(std::memcmp(once.data(), other.data(), once.size() * sizeof(double)), 0);
  double mean = 0, square = 0;
  for (const double e : once) {
    mean += e;
    square += e * e;
  }
  const double samples = static_cast<double>(once.size());
  EXPECT_NEAR(mean / samples, 0, 4 * 1e-4 / std::sqrt(samples));
  EXPECT_NEAR(std::sqrt(square / samples), 1e-4, 1e-6);
}

TEST(Mechanics, InvalidOptionsAreRefused) {
  const DeviceDescription device = default_device_description();
  for (int n = 0; n < 6; ++n) {
    SimulatedDeviceOptions options;
    options.mechanics = MechanicsOptions{};
    HandImpedance impedance;
    if (n == 0) options.mechanics->link_mass_kg[2] = -1;
    if (n == 1) options.mechanics->rotor_inertia_kg_m2 = std::nan("");
    if (n == 2) options.mechanics->presliding_rad = 0;
    if (n == 3) options.mechanics->current_lag_s = INFINITY;
    if (n == 4) impedance.mass_kg = -0.1;
    if (n == 5) impedance.let_go_t_s = std::nan("");
    EXPECT_FALSE(SimulatedDevice::make(device, rest_at(0.15), impedance, options)) << n;
  }
}

}  // namespace
}  // namespace trocar::runtime
