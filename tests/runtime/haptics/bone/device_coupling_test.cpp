// SPDX-License-Identifier: Apache-2.0
// The coupling of tool and plate against the rule for stiffness and the device's torques, computed
// directly; and the force law that is made with it.

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <string>
#include <vector>

#include "runtime/device/four_legs/four_legs.h"
#include "runtime/device/four_legs/kinematics.h"
#include "runtime/device/four_legs/torque_allocation.h"
#include "runtime/haptics/bone/cutting_force_law.h"
#include "tests/support/body_fixture.h"
#include "tests/support/device_workspace.h"
#include "tests/support/exact_device.h"

namespace trocar::runtime {
namespace {

// The coupling of tool and plate against the device's damping and torques, computed directly.

Pose upright(double x_m = 0, double z_m = 0.15) {
  Pose T;
  T.p_m = {x_m, 0, z_m};
  return T;
}

/// Motor rates by central differences of the inverse kinematics.
Jacobian by_differences(const DeviceDescription& device, const Pose& T) {
  constexpr double kStep = 2e-7;
  Jacobian G;
  for (int column = 0; column < 6; ++column) {
    std::array<MotorVector, 2> angles;
    for (int side = 0; side < 2; ++side) {
      Eigen::Vector3d along = Eigen::Vector3d::Zero();
      along[column % 3] = side == 0 ? -kStep : kStep;
      Pose moved = T;
      if (column < 3)
        moved.p_m += along;
      else
        moved.q = from_rotation_vector(along) * T.q;
      const InverseResult joints = inverse_kinematics(device, moved);
      EXPECT_TRUE(joints.status);
      angles[static_cast<std::size_t>(side)] = motor_angles(joints.joints);
    }
    G.col(column) = (angles[1] - angles[0]) / (2 * kStep);
  }
  return G;
}

/// A sheet of no thickness: 5 kN/m, no shaft.
BoneVolume one_sheet() {
  return test::bone_volume_of(test::cutting_scene({0.12}), test::square_asset(1));
}

/// A body with walls of 55 kN/m a millimetre.
BoneVolume bone_volume() {
  Scene scene = test::cutting_scene(test::stack(0.12, 1e-3, 4));
  scene.tissue.cut = CutTissue{4, std::nullopt, 0, 1, 0, 0, 20, 10, 12};
  return test::bone_volume_of(scene, test::square_asset(4));
}

SceneForceLaw coupled(double translation_N_per_m = 10'000, double rotation_Nm_per_rad = 25) {
  SceneForceLaw law;
  law.kind = ForceLawKind::kCutting;
  law.axis = ToolAxis::kCoupled;
  law.coupling_N_per_m = translation_N_per_m;
  law.coupling_Nm_per_rad = rotation_Nm_per_rad;
  return law;
}

using test::exact_device;

Result<DeviceCoupling> try_to_choose(const BoneVolume& body, const SceneForceLaw& law,
                                     const DeviceDescription& device, const Pose& T = upright(),
                                     double rate_Hz = 1000, const StiffnessLimits& limits = {}) {
  return choose_coupling(body, law, FourLegsSpecification(device), T, rate_Hz, limits);
}
DeviceCoupling choose(const BoneVolume& body, const SceneForceLaw& law,
                      const DeviceDescription& device, const Pose& T = upright(),
                      double rate_Hz = 1000, const StiffnessLimits& limits = {}) {
  auto chosen = try_to_choose(body, law, device, T, rate_Hz, limits);
  EXPECT_TRUE(chosen) << chosen.error().message;
  return chosen ? *chosen : DeviceCoupling{};
}

TEST(DeviceCoupling, TheAxisIsRigidIfTheSceneSaysSoOrTheTissueIsSofter) {
  const DeviceDescription device = exact_device();
  SceneForceLaw law = coupled();
  EXPECT_FALSE(choose(one_sheet(), law, device).coupling.is_rigid);
  law.axis = ToolAxis::kRigid;
  EXPECT_TRUE(choose(one_sheet(), law, device).coupling.is_rigid);
  law.axis = ToolAxis::kAuto;
  EXPECT_TRUE(choose(one_sheet(), law, device).coupling.is_rigid) << "5 kN/m, 10 kN/m";
  EXPECT_FALSE(choose(bone_volume(), law, device).coupling.is_rigid) << "walls";
  law.coupling_N_per_m = 4900;
  EXPECT_FALSE(choose(one_sheet(), law, device).coupling.is_rigid) << "5 kN/m, 4.9 kN/m";
  law.coupling_N_per_m = 5100;
  EXPECT_TRUE(choose(one_sheet(), law, device).coupling.is_rigid);
  // Viscous friction is as stiff as its change in a tick: 10 N s/m at 1 kHz are 10 kN/m.
  Scene scene = test::cutting_scene({0.12});
  scene.tissue.shaft.viscous_friction_N_s_per_m = 9;
  law.coupling_N_per_m = 10'000;
  const BoneVolume viscous = test::bone_volume_of(scene, test::square_asset(1));
  EXPECT_TRUE(choose(viscous, law, device).coupling.is_rigid);
  EXPECT_FALSE(choose(viscous, law, device, upright(), 2000).coupling.is_rigid);
}

double stable_of(const DeviceDescription& device, double rate_Hz, double margin = 1) {
  return stable_stiffness({1 / rate_Hz, device.delay_s.value_or(0)},
                          plate_axes(FourLegsSpecification(device), upright()).translation, margin);
}

// At most 0.1 M / tau^2 or b / tau; the damping of the plate by central differences.
TEST(DeviceCoupling, TheLargestTangentIsStable) {
  for (const int counts : {0, 360'000, 20'000}) {
    for (const double delay_s : {0.0, 1e-3}) {
      for (const double rate_Hz : {500.0, 1000.0, 4000.0}) {
        DeviceDescription device = exact_device();
        device.encoder_counts_per_revolution = counts;
        device.delay_s = delay_s;
        const Jacobian G = by_differences(device, upright());
        const Eigen::Matrix3d B =
            device.joint_viscous_friction_Nms_per_rad * (G.transpose() * G).topLeftCorner<3, 3>();
        const double tau_s = 0.5 / rate_Hz + delay_s,
                     b = B.selfadjointView<Eigen::Lower>().eigenvalues()[0];
        const double most = std::max(b / tau_s, 0.1 * device.plate_mass_kg / (tau_s * tau_s));
        const DeviceCoupling chosen =
            choose(bone_volume(), coupled(0, 0), device, upright(), rate_Hz);
        const StiffeningSpring spring = chosen.coupling.translation();
        EXPECT_LE(spring.stiff, most * (1 + 1e-6)) << counts << ", " << rate_Hz << ", " << delay_s;
        if (counts == 0) {
          EXPECT_EQ(spring.soft, spring.stiff) << "nothing alternates";
          EXPECT_NEAR(spring.stiff, stable_of(device, rate_Hz), 1e-6);
        }
        EXPECT_LE(chosen.coupling.rotation_Nm_per_rad,
                  0.1 *
                          *std::min_element(device.plate_inertia_kg_m2.begin(),
                                            device.plate_inertia_kg_m2.end()) /
                          (tau_s * tau_s) +
                      1e-3 / tau_s);
      }
    }
  }
}

// K(F) = max(0.1 N, F / 100) / s, with s from the estimator that the law gets.
TEST(DeviceCoupling, ItStiffensAsMuchAsTheForceHides) {
  DeviceDescription device = exact_device();
  for (const int counts : {360'000, 100'000}) {
    device.encoder_counts_per_revolution = counts;
    const DeviceCoupling chosen = choose(bone_volume(), coupled(0, 0), device);
    const double count_m = 2 * std::numbers::pi / counts * device.geometry.l1_m;
    const StepGain gain = step_gain(chosen.design.estimator.translation, 1e-3);
    const double s = 1.5 * gain.first * count_m;
    const StiffeningSpring spring = chosen.coupling.translation();
    EXPECT_NEAR(spring.soft, 0.1 / s, 1e-6 / s);
    for (const double force_N : {12.0, 20.0, 35.0}) {
      const StiffeningForce at = stiffening_force(spring, HUGE_VAL, length_at(spring, force_N));
      EXPECT_NEAR(at.force, force_N, 1e-9);
      EXPECT_NEAR(at.along, std::min(force_N / 100 / s, spring.stiff), 1e-6 / s);
    }
    EXPECT_EQ(chosen.extension_m(20), length_at(spring, 20));
  }
}

// A description that is true: no other largest tangent gives way less at 50 N.
TEST(DeviceCoupling, AmongAllTangentsItGivesWayLeast) {
  DeviceDescription device = exact_device();
  device.encoder_noise_rad = 2e-5;
  const PlateAxis axis = plate_axes(FourLegsSpecification(device), upright()).translation;
  const double extension_m = choose(bone_volume(), coupled(0, 0), device).extension_m(50);
  for (int i = 0; i < 60; ++i) {
    const double stiff = stable_of(device, 1000) * std::pow(0.93, i);
    const auto estimator = design_estimator({1e-3, 0}, axis, stiff);
    if (!estimator) continue;
    const double s = step_gain(*estimator, 1e-3).alternation_m(axis);
    EXPECT_LT(extension_m, 1.03 * length_at({std::min(0.1 / s, stiff), stiff, 10}, 50)) << stiff;
  }
}

// Real hardware: the mass that its description states is a measurement.
TEST(DeviceCoupling, AMarginDividesTheMass) {
  const DeviceDescription device = exact_device();
  const DeviceCoupling half =
      choose(bone_volume(), coupled(0, 0), device, upright(), 1000, {.margin = 2});
  EXPECT_NEAR(half.coupling.translation_N_per_m, stable_of(device, 1000, 2), 1e-6);
  EXPECT_LT(stable_of(device, 1000, 2), 0.6 * stable_of(device, 1000));
}

TEST(DeviceCoupling, NeverStifferThanStableOrWhatTheDeviceStatesOrTheOperatorAllows) {
  for (const double stated_N_per_m : {0.0, 3000.0, 60'000.0}) {
    for (const double allowed_N_per_m : {HUGE_VAL, 8000.0, 90'000.0}) {
      DeviceDescription device = exact_device();
      device.plate_stiffness_max_N_per_m = stated_N_per_m;
      const double ceiling_N_per_m =
          std::min(stated_N_per_m > 0 ? stated_N_per_m : HUGE_VAL, allowed_N_per_m);
      for (const double scale : {0.2, 1.0}) {
        for (const double of_scene : {0.0, 20'000.0, 1e6}) {
          for (const ToolAxis axis : {ToolAxis::kAuto, ToolAxis::kCoupled}) {
            SceneForceLaw law = coupled(of_scene, of_scene > 0 ? 1e4 : 0);
            law.axis = axis;
            law.force_scale = scale;
            const BoneVolume bone = bone_volume();
            const DeviceCoupling chosen =
                choose(bone, law, device, upright(), 1000, {.max_N_per_m = allowed_N_per_m});
            if (chosen.coupling.is_rigid) continue;  // the walls are softer than a stiff coupling
            const double most = std::min(ceiling_N_per_m, stable_of(device, 1000));
            const double wanted = of_scene > 0 ? std::min(scale * of_scene, most) : most;
            EXPECT_NEAR(scale * chosen.coupling.translation_N_per_m, wanted, 1e-9 * wanted);
            EXPECT_EQ(chosen.is_at_ceiling,
                      ceiling_N_per_m < stable_of(device, 1000) &&
                          (of_scene == 0 || scale * of_scene > ceiling_N_per_m));
            const double lever_m = std::max(bone.tool.tip_plate_m.norm(), 0.05);
            EXPECT_LE(scale * chosen.coupling.rotation_Nm_per_rad,
                      ceiling_N_per_m * lever_m * lever_m * (1 + 1e-12));
          }
        }
      }
    }
  }
}

// Friction and hold of a tip of 35 N are springs of more than 100 kN/m until they yield.
TEST(DeviceCoupling, TheFrictionOfTheTipCountsAgainstAStatedStiffness) {
  DeviceDescription device = exact_device();
  device.plate_stiffness_max_N_per_m = 20'000;
  SceneForceLaw law = coupled();
  law.axis = ToolAxis::kRigid;
  BoneVolume bone = one_sheet();
  EXPECT_GT(bone.yielding_N_per_m, 100'000);
  EXPECT_FALSE(choose(bone, law, device).coupling.is_rigid);
  bone.yielding_N_per_m = 0;
  EXPECT_TRUE(choose(bone, law, device).coupling.is_rigid);
}

// K tau^2 / M above 0.125 is refused; kAuto takes a coupling.
TEST(DeviceCoupling, ARigidAxisThatIsTooStiffForItsRateIsRefused) {
  const DeviceDescription device = exact_device();
  for (const double rate_Hz : {500.0, 1000.0, 4000.0}) {
    for (const double share : {0.5, 0.9, 1.2, 3.0}) {
      BoneVolume bone = one_sheet();
      SceneForceLaw law = coupled(0, 0);
      law.force_scale = 0.25;
      const double tau_s = 0.5 / rate_Hz;
      bone.along_N_per_m = share * 0.1 * device.plate_mass_kg / (tau_s * tau_s) / 0.25;
      bone.across_N_per_m = 0;
      law.axis = ToolAxis::kRigid;
      const auto chosen = try_to_choose(bone, law, device, upright(), rate_Hz);
      EXPECT_EQ(static_cast<bool>(chosen), share <= 1) << rate_Hz << " Hz, " << share;
      if (!chosen) {
        EXPECT_EQ(chosen.error().code, ExitCode::kRefused);
      }
      law.axis = ToolAxis::kAuto;
      EXPECT_EQ(choose(bone, law, device, upright(), rate_Hz).coupling.is_rigid, share <= 1);
    }
  }
}

// A sheet of 5 kN/m has no walls, but 5 cm beside the plate's middle its force turns the plate.
TEST(DeviceCoupling, ATipBesideThePlatesMiddleTurnsThePlate) {
  const DeviceDescription device = exact_device();
  BoneVolume bone = one_sheet();
  SceneForceLaw law = coupled(10'000, 10);
  law.axis = ToolAxis::kAuto;
  bone.tool.tip_plate_m = {0, 0, -0.1};
  EXPECT_TRUE(choose(bone, law, device).coupling.is_rigid);
  bone.tool.tip_plate_m = {0.05, 0, -0.1};
  EXPECT_FALSE(choose(bone, law, device).coupling.is_rigid) << "12.5 Nm/rad, 10 Nm/rad";
}

TEST(DeviceCoupling, ASoftCouplingIsToldWithItsExtension) {
  DeviceDescription device = exact_device();
  Scene scene = test::cutting_scene(test::stack(0.12, 1e-3, 4));
  scene.force_law.axis = ToolAxis::kCoupled;
  const test::Placed placed(scene, test::square_asset(4));
  for (const double noise_rad : {0.0, 2e-4}) {
    device.encoder_noise_rad = noise_rad;
    const FourLegsSpecification specification(device);
    const auto law = CuttingForceLaw::make({scene, specification, placed.sheets, 1000, {}, {}});
    ASSERT_TRUE(law) << law.error().message;
    EXPECT_EQ((*law)->contact_warning().empty(), noise_rad == 0) << (*law)->contact_warning();
    EXPECT_NE((*law)->describe().find("extended by"), std::string::npos);
  }
}

TEST(DeviceCoupling, TheLargestForceIsWhatTheDeviceGivesAtItsPeak) {
  const DeviceDescription device = exact_device();
  testing_support::Random random(12);
  const testing_support::Workspace workspace;
  for (int trial = 0; trial < 20; ++trial) {
    const Pose T = trial == 0 ? upright() : random_workspace_pose(random, workspace);
    const Jacobian G = by_differences(device, T);
    SceneForceLaw law = coupled();
    const BoneVolume body = bone_volume();
    const DeviceCoupling chosen = choose(body, law, device, T);
    const Eigen::Vector3d up = T.q * body.tool.axis_plate;
    const auto is_given = [&](double force_N, double moment_Nm, const Eigen::Vector3d& about) {
      Wrench wrench;
      wrench << force_N * up, moment_Nm * about;
      return allocate_torques(G, wrench, device.motor_peak_torque_Nm).scale >= 1;
    };
    ASSERT_GT(chosen.max_N, 1);
    EXPECT_EQ(chosen.coupling.max_force_N, chosen.max_N);
    EXPECT_TRUE(is_given(0.99 * chosen.max_N, 0, up)) << trial;
    EXPECT_FALSE(is_given(1.01 * chosen.max_N, 0, up)) << trial;
    bool one_is_not = false;
    for (int i = 0; i < 3; ++i) {
      EXPECT_TRUE(is_given(0, 0.99 * chosen.coupling.max_moment_Nm, Eigen::Vector3d::Unit(i)));
      one_is_not |= !is_given(0, 1.01 * chosen.coupling.max_moment_Nm, Eigen::Vector3d::Unit(i));
    }
    EXPECT_TRUE(one_is_not) << trial;
    law.force_scale = 0.2;
    EXPECT_NEAR(choose(body, law, device, T).max_N, 5 * chosen.max_N, 1e-6 * chosen.max_N)
        << "of tissue";
  }
}

// The force law `cutting` without a session, tick by tick.

// A strong layer breaks at 20 N, and the coupling drives the tip through it and 1.6 mm into a weak
// layer, which the tip has not touched before.
TEST(CuttingForceLaw, ALayerThatIsReachedAndPuncturedInOneTickIsReported) {
  Scene scene = test::cutting_scene({0.11});
  SceneLayer strong{.name = "fascia", .top_z_m = 0.12, .thickness_m = 1e-3};
  strong.stiffness_N_per_m = 1e5;
  strong.puncture_N = 20;
  strong.cutting_N = 12;
  SceneLayer weak{.name = "dura", .top_z_m = 0.1185, .thickness_m = 1e-3};
  weak.stiffness_N_per_m = 5000;
  weak.puncture_N = 2;
  weak.cutting_N = 1;
  scene.layers = {strong, weak};
  scene.force_law.axis = ToolAxis::kCoupled;
  scene.force_law.coupling_N_per_m = 4000;
  scene.force_law.coupling_Nm_per_rad = 10;
  scene.force_law.force_scale = 0.1;  // so that the device can render the forces
  const test::Placed placed(scene, test::square_asset(1));
  const FourLegsSpecification device(default_device_description());
  const auto law = CuttingForceLaw::make({scene, device, placed.sheets, 1000, {}, {}});
  ASSERT_TRUE(law) << law.error().message;
  std::vector<std::uint64_t> punctured;
  for (int k = 0; k <= 650; ++k) {
    ForceLawInput input;
    input.sheets = placed.sheets;
    input.T_device_plate.p_m = {0, 0, 0.1205 - 1e-5 * k};
    input.T_device_measured = input.T_device_plate;
    input.pose_interval_s = 1e-3;
    ContactOutput output;
    ASSERT_EQ((*law)->update(input, output).fault, Fault::kNone);
    if (output.layers_punctured != 0) punctured.push_back(output.layers_punctured);
  }
  EXPECT_EQ(punctured, std::vector<std::uint64_t>{0b11}) << "both in one tick, and only then";
}

// A rigid axis in stiff tissue gives 0.24 J in a tick of 4 ms. Such a session does not start, and the
// rate that is named does.
TEST(CuttingForceLaw, ARigidAxisIsRefusedWithTheRateThatWouldDo) {
  Scene scene = test::cutting_scene({0.12});
  scene.tissue.stiffness_N_per_m = 100'000;
  scene.force_law.axis = ToolAxis::kRigid;
  const test::Placed placed(scene, test::square_asset(1));
  const FourLegsSpecification device(default_device_description());
  const auto make = [&](double rate_Hz) {
    return CuttingForceLaw::make({scene, device, placed.sheets, rate_Hz, {}, {}});
  };
  for (const double rate_Hz : {100.0, 250.0, 500.0}) {
    const auto law = make(rate_Hz);
    ASSERT_FALSE(law) << rate_Hz;
    EXPECT_EQ(law.error().code, ExitCode::kRefused);
    const std::string& why = law.error().message;
    const std::size_t at = why.find("at least ");
    ASSERT_NE(at, std::string::npos) << why;
    const double enough_Hz = std::stod(why.substr(at + 9));
    EXPECT_TRUE(make(enough_Hz)) << why;
    EXPECT_FALSE(make(enough_Hz - 2)) << why;
  }
  scene.tissue.stiffness_N_per_m = 1e8;  // no rate would do
  const test::Placed hard(scene, test::square_asset(1));
  const auto law = CuttingForceLaw::make({scene, device, hard.sheets, 1000, {}, {}});
  ASSERT_FALSE(law);
  EXPECT_EQ(law.error().message.find("at least"), std::string::npos) << law.error().message;
  scene.force_law.axis = ToolAxis::kAuto;
  EXPECT_TRUE(CuttingForceLaw::make({scene, device, hard.sheets, 250, {}, {}}));
}

}  // namespace
}  // namespace trocar::runtime
