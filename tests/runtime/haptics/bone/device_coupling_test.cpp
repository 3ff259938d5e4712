// SPDX-License-Identifier: Apache-2.0
// The coupling of tool and plate against the device's damping and torques, computed directly; and the
// force law that is made with it.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

#include "runtime/device/four_legs/four_legs.h"
#include "runtime/device/four_legs/kinematics.h"
#include "runtime/device/four_legs/torque_allocation.h"
#include "runtime/haptics/bone/cutting_force_law.h"
#include "tests/reference/decompositions/decompositions.h"
#include "tests/support/body_fixture.h"
#include "tests/support/device_workspace.h"

namespace trocar::runtime {
namespace {

// The coupling of tool and plate against the device's damping and torques, computed directly.

using Matrix6 = Eigen::Matrix<double, 6, 6>;

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

Matrix6 damping_of(const DeviceDescription& device, const Pose& T) {
  const Jacobian G = by_differences(device, T);
  return device.joint_viscous_friction_Nms_per_rad * G.transpose() * G;
}

Matrix6 stiffness(double translation_N_per_m, double rotation_Nm_per_rad) {
  Eigen::Matrix<double, 6, 1> K;
  K << Eigen::Vector3d::Constant(translation_N_per_m),
      Eigen::Vector3d::Constant(rotation_Nm_per_rad);
  return K.asDiagonal();
}

double smallest_eigenvalue(const Matrix6& A) {
  return reference::eigenvalues(A)[0];
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

DeviceCoupling choose(BoneVolume body, const SceneForceLaw& law, const DeviceDescription& device,
                      const Pose& T = upright(), double rate_Hz = 1000,
                      const StiffnessLimits& limits = {}) {
  // Sets the options as make_bone_volume() does from the scene's law.
  body.options.coupling.translation_N_per_m = law.coupling_N_per_m;
  body.options.coupling.rotation_Nm_per_rad = law.coupling_Nm_per_rad;
  return choose_coupling(body, law, FourLegsSpecification(device), T, rate_Hz, limits);
}

TEST(DeviceCoupling, TheAxisIsRigidIfTheSceneSaysSoOrTheTissueIsSofter) {
  const DeviceDescription device = default_device_description();
  SceneForceLaw law = coupled();
  EXPECT_FALSE(choose(one_sheet(), law, device).coupling.is_rigid);
  law.axis = ToolAxis::kRigid;
  EXPECT_TRUE(choose(one_sheet(), law, device).coupling.is_rigid);
  EXPECT_TRUE(choose(bone_volume(), law, device).coupling.is_rigid);
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

TEST(DeviceCoupling, TheDampingShareIsTheLargestForWhichTheDampingSuffices) {
  testing_support::Random random(11);
  const testing_support::Workspace workspace;
  for (int trial = 0; trial < 40; ++trial) {
    DeviceDescription device = default_device_description();
    device.joint_viscous_friction_Nms_per_rad = 0.001 * (1 + trial);
    const Pose T = trial == 0 ? upright() : random_workspace_pose(random, workspace);
    const double rate_Hz = 500.0 * (1 + trial % 8), scale = trial % 3 == 0 ? 1 : 0.2;
    SceneForceLaw law = coupled(2000.0 + 700 * trial, 2.0 + trial);
    law.force_scale = scale;
    law.prediction = PosePrediction::kOff;
    const double share = choose(bone_volume(), law, device, T, rate_Hz).damping_share;
    ASSERT_GT(share, 0);
    const Matrix6 B = damping_of(device, T),
                  need = scale / (2 * rate_Hz) *
                         stiffness(law.coupling_N_per_m, law.coupling_Nm_per_rad);
    const double direct = reference::eigenvalues(B, need)[0];
    EXPECT_NEAR(share, direct, 1e-5 * direct) << trial;
    EXPECT_GT(smallest_eigenvalue(B - 0.999 * share * need), 0) << trial;
    EXPECT_LT(smallest_eigenvalue(B - 1.001 * share * need), 0) << trial;
  }
}

TEST(DeviceCoupling, ItPredictsWhereTheDampingIsTooSmall) {
  DeviceDescription device = default_device_description();
  for (const double friction : {1e-4, 5.0}) {
    device.joint_viscous_friction_Nms_per_rad = friction;
    SceneForceLaw law = coupled();
    DeviceCoupling chosen = choose(bone_volume(), law, device);
    ASSERT_EQ(chosen.damping_share < 1, friction < 1);
    EXPECT_EQ(chosen.predicts_pose, friction < 1);
    EXPECT_EQ(describe(chosen, law).find("a tick ahead") != std::string::npos, friction < 1);
    law.prediction = PosePrediction::kOn;
    EXPECT_TRUE(choose(bone_volume(), law, device).predicts_pose);
    law.prediction = PosePrediction::kOff;
    chosen = choose(bone_volume(), law, device);
    EXPECT_FALSE(chosen.predicts_pose);
    EXPECT_EQ(stability_warning(chosen).find("without prediction") != std::string::npos,
              friction < 1);
    EXPECT_EQ(chosen.coupling.translation_N_per_m, 10'000) << "as the scene says";
    EXPECT_EQ(chosen.coupling.rotation_Nm_per_rad, 25);
  }
}

TEST(DeviceCoupling, WithAPredictionTheStiffnessIsWithinWhatWasTried) {
  const DeviceDescription device = default_device_description();
  for (const double rate_Hz : {100.0, 250.0, 500.0, 1000.0, 2000.0, 4000.0, 8000.0}) {
    for (const double scale : {0.1, 0.5, 1.0, 4.0}) {
      for (const ToolAxis axis : {ToolAxis::kCoupled, ToolAxis::kAuto}) {
        for (const BoneVolume& body : {bone_volume(), one_sheet()}) {
          SceneForceLaw law = coupled(1e6, 1e4);
          law.axis = axis;
          law.prediction = PosePrediction::kOn;
          law.force_scale = scale;
          const DeviceCoupling chosen = choose(body, law, device, upright(), rate_Hz);
          const double max_N_per_m = 0.5 * device.plate_mass_kg * rate_Hz * rate_Hz,
                       most_Nm_per_rad = 0.5 * device.plate_inertia_kg_m2[0] * rate_Hz * rate_Hz;
          const double K = chosen.coupling.is_rigid
                               ? std::max(body.along_N_per_m, body.across_N_per_m)
                               : chosen.coupling.translation_N_per_m;
          EXPECT_LE(scale * K, max_N_per_m * (1 + 1e-12))
              << rate_Hz << " Hz, scale " << scale << (chosen.coupling.is_rigid ? ", rigid" : "");
          EXPECT_EQ(stability_warning(chosen).empty(), rate_Hz >= 400)
              << rate_Hz << " Hz, scale " << scale << ": " << stability_warning(chosen);
          if (chosen.coupling.is_rigid) continue;
          EXPECT_LE(scale * chosen.coupling.rotation_Nm_per_rad, most_Nm_per_rad * (1 + 1e-12));
          EXPECT_NEAR(scale * chosen.coupling.translation_N_per_m,
                      std::min(scale * 1e6, max_N_per_m), 1e-6 * max_N_per_m)
              << "no softer than needed";
        }
      }
    }
  }
}

TEST(DeviceCoupling, ItWarnsOfMotionsAboveASixthOfALowRate) {
  SceneForceLaw law = coupled(0, 0);
  const DeviceDescription device = default_device_description();
  EXPECT_NE(stability_warning(choose(bone_volume(), law, device, upright(), 250)).find("41.7 Hz"),
            std::string::npos);
  EXPECT_EQ(stability_warning(choose(bone_volume(), law, device, upright(), 400)), "");
  law = coupled(1, 1e-3);
  EXPECT_EQ(stability_warning(choose(bone_volume(), law, device, upright(), 250)), "")
      << "the device's damping suffices without a prediction";
}

// Real hardware: the mass that its description states is a measurement.
TEST(DeviceCoupling, AMarginDividesWhatTheMassAllows) {
  const DeviceDescription device = default_device_description();
  for (const bool is_stated : {false, true}) {
    const SceneForceLaw law = is_stated ? coupled(1e7, 1e5) : coupled(0, 0);
    const DeviceCoupling full = choose(bone_volume(), law, device),
                         half = choose(bone_volume(), law, device, upright(), 1000, {.margin = 2});
    EXPECT_NEAR(half.coupling.translation_N_per_m, full.coupling.translation_N_per_m / 2, 1e-6);
    EXPECT_NEAR(half.coupling.rotation_Nm_per_rad, full.coupling.rotation_Nm_per_rad / 2, 1e-9);
    EXPECT_NEAR(full.inertia_share, 0.5, 1e-9);
    EXPECT_NEAR(half.inertia_share, 0.25, 1e-9);
    EXPECT_EQ(stability_warning(half), "");
  }
  SceneForceLaw rigid = coupled();
  rigid.axis = ToolAxis::kRigid;
  rigid.prediction = PosePrediction::kOn;
  BoneVolume bone = bone_volume();
  bone.along_N_per_m = 0.4 * device.plate_mass_kg * 1e6;
  bone.across_N_per_m = 0;
  EXPECT_TRUE(may_start(choose(bone, rigid, device)));
  EXPECT_FALSE(may_start(choose(bone, rigid, device, upright(), 1000, {.margin = 2})));
}

TEST(DeviceCoupling, NeverStifferThanTheDeviceStatesOrTheOperatorAllows) {
  for (const double stated_N_per_m : {0.0, 3000.0, 60'000.0}) {
    for (const double allowed_N_per_m : {HUGE_VAL, 8000.0, 90'000.0}) {
      DeviceDescription device = default_device_description();
      device.plate_stiffness_max_N_per_m = stated_N_per_m;
      const double ceiling_N_per_m =
          std::min(stated_N_per_m > 0 ? stated_N_per_m : HUGE_VAL, allowed_N_per_m);
      for (const double scale : {0.2, 1.0}) {
        for (const ToolAxis axis : {ToolAxis::kAuto, ToolAxis::kCoupled, ToolAxis::kRigid}) {
          for (const PosePrediction prediction : {PosePrediction::kOn, PosePrediction::kOff}) {
            SceneForceLaw law = coupled(1e6, 1e4);
            law.axis = axis;
            law.prediction = prediction;
            law.force_scale = scale;
            const BoneVolume bone = bone_volume();
            const DeviceCoupling chosen =
                choose(bone, law, device, upright(), 1000, {.max_N_per_m = allowed_N_per_m});
            const double K = chosen.coupling.is_rigid
                                 ? std::max(bone.along_N_per_m, bone.across_N_per_m)
                                 : chosen.coupling.translation_N_per_m;
            EXPECT_LE(scale * K, ceiling_N_per_m * (1 + 1e-12));
            EXPECT_EQ(chosen.is_at_ceiling, scale * 1e6 > ceiling_N_per_m);
            if (!chosen.is_at_ceiling) continue;
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
  DeviceDescription device = default_device_description();
  device.plate_stiffness_max_N_per_m = 20'000;
  SceneForceLaw law = coupled();
  law.axis = ToolAxis::kRigid;
  BoneVolume bone = one_sheet();
  EXPECT_GT(bone.yielding_N_per_m, 100'000);
  EXPECT_FALSE(choose(bone, law, device).coupling.is_rigid);
  bone.yielding_N_per_m = 0;
  EXPECT_TRUE(choose(bone, law, device).coupling.is_rigid);
}

// A scene that states no stiffness gets the largest that the device holds, in each of both alone as well.
TEST(DeviceCoupling, WithoutAStiffnessItIsTheLargest) {
  const DeviceDescription device = default_device_description();
  for (const double rate_Hz : {250.0, 1000.0, 4000.0}) {
    for (const double scale : {0.5, 1.0}) {
      const double max_N_per_m = 0.5 * device.plate_mass_kg * rate_Hz * rate_Hz / scale,
                   most_Nm_per_rad = 0.5 *
                                     *std::min_element(device.plate_inertia_kg_m2.begin(),
                                                       device.plate_inertia_kg_m2.end()) *
                                     rate_Hz * rate_Hz / scale;
      const auto stiffness_of = [&](double N_per_m, double Nm_per_rad) {
        SceneForceLaw law = coupled(N_per_m, Nm_per_rad);
        law.force_scale = scale;
        return choose(bone_volume(), law, device, upright(), rate_Hz).coupling;
      };
      CuttingCoupling chosen = stiffness_of(0, 0);
      EXPECT_NEAR(chosen.translation_N_per_m, max_N_per_m, 1e-9 * max_N_per_m);
      EXPECT_NEAR(chosen.rotation_Nm_per_rad, most_Nm_per_rad, 1e-9 * most_Nm_per_rad);
      chosen = stiffness_of(100, 0);
      EXPECT_EQ(chosen.translation_N_per_m, 100);
      EXPECT_NEAR(chosen.rotation_Nm_per_rad, most_Nm_per_rad, 1e-9 * most_Nm_per_rad);
    }
  }
}

// K T^2 / M of what is rendered, and the refusal if it is more than what was tried.
TEST(DeviceCoupling, ARigidAxisThatIsTooStiffForItsRateIsRefused) {
  const DeviceDescription device = default_device_description();
  Scene scene = test::cutting_scene({0.12});
  scene.tissue.stiffness_N_per_m = 50'000;
  const BoneVolume bone = test::bone_volume_of(scene, test::square_asset(1));
  SceneForceLaw law = coupled();
  law.axis = ToolAxis::kRigid;
  for (const double rate_Hz : {250.0, 1000.0, 4000.0}) {
    for (const double scale : {0.25, 1.0}) {
      law.force_scale = scale;
      const DeviceCoupling chosen = choose(bone, law, device, upright(), rate_Hz);
      const double share = scale * 50'000 / (rate_Hz * rate_Hz * device.plate_mass_kg);
      ASSERT_TRUE(chosen.predicts_pose);
      EXPECT_NEAR(chosen.inertia_share, share, 1e-9 * share) << "a sheet has no walls";
      EXPECT_EQ(may_start(chosen), share <= 0.5) << share;
      if (share <= 0.5) continue;
      const std::string why = why_not_passive(chosen, 600);
      for (const std::string& part :
           {"K T^2 / M is " + std::to_string(share).substr(0, 3), std::string("at least 600 Hz")})
        EXPECT_NE(why.find(part), std::string::npos) << why;
      // The stiffness that would do does.
      const std::size_t at = why.find("at most ", why.find("instead of a stiffness")) + 8;
      Scene softer = scene;
      softer.tissue.stiffness_N_per_m = 0.999 * std::stod(why.substr(at));
      EXPECT_TRUE(may_start(choose(test::bone_volume_of(softer, test::square_asset(1)), law, device,
                                   upright(), rate_Hz)))
          << why;
    }
  }
}

// Without prediction the device's damping must suffice, whatever the axis is.
TEST(DeviceCoupling, ACouplingThatIsTooStiffForItsRateIsRefusedToo) {
  DeviceDescription device = default_device_description();
  SceneForceLaw law = coupled(1e6, 10);
  law.prediction = PosePrediction::kOff;
  EXPECT_FALSE(may_start(choose(bone_volume(), law, device, upright(), 250)));
  EXPECT_NE(why_not_passive(choose(bone_volume(), law, device, upright(), 250), 0)
                .find("lower coupling_N_per_m"),
            std::string::npos);
  law.prediction = PosePrediction::kAuto;
  EXPECT_TRUE(may_start(choose(bone_volume(), law, device, upright(), 250)))
      << "with prediction the spring is within the limit";
  law = coupled(100, 0.1);
  law.prediction = PosePrediction::kOff;
  EXPECT_TRUE(may_start(choose(bone_volume(), law, device)));
  device.joint_viscous_friction_Nms_per_rad = 1e4;
  law = coupled(1e6, 10);
  law.prediction = PosePrediction::kOff;
  EXPECT_TRUE(may_start(choose(bone_volume(), law, device, upright(), 250)))
      << "its damping suffices";
}

// A sheet of 5 kN/m has no walls, but 5 cm beside the plate's middle its force turns the plate.
TEST(DeviceCoupling, ATipBesideThePlatesMiddleTurnsThePlate) {
  const DeviceDescription device = default_device_description();
  BoneVolume bone = one_sheet();
  SceneForceLaw law = coupled(10'000, 10);
  law.axis = ToolAxis::kAuto;
  bone.tool.tip_plate_m = {0, 0, -0.1};
  EXPECT_TRUE(choose(bone, law, device).coupling.is_rigid);
  bone.tool.tip_plate_m = {0.05, 0, -0.1};
  EXPECT_FALSE(choose(bone, law, device).coupling.is_rigid) << "12.5 Nm/rad, 10 Nm/rad";
  law.axis = ToolAxis::kRigid;
  EXPECT_NEAR(choose(bone, law, device).inertia_share, 12.5 / (1e6 * device.plate_inertia_kg_m2[0]),
              1e-9);
}

TEST(DeviceCoupling, TheLargestForceIsWhatTheDeviceGivesAtItsPeak) {
  const DeviceDescription device = default_device_description();
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

TEST(DeviceCoupling, OutOfReachNothingIsKnown) {
  const DeviceCoupling chosen =
      choose(bone_volume(), coupled(), default_device_description(), upright(5));
  EXPECT_EQ(chosen.damping_share, 0);
  EXPECT_TRUE(chosen.predicts_pose);
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
  scene.force_law.prediction = PosePrediction::kOff;
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
    input.pose_interval_s = 1e-3;
    ContactOutput output;
    ASSERT_EQ((*law)->update(input, output).fault, Fault::kNone);
    if (output.layers_punctured != 0) punctured.push_back(output.layers_punctured);
  }
  EXPECT_EQ(punctured, std::vector<std::uint64_t>{0b11}) << "both in one tick, and only then";
}

// A rigid axis in stiff tissue gives 0.24 J in a tick of 4 ms. Such a session does not start, and the
// rate that is named does.
TEST(CuttingForceLaw, AStiffnessThatIsNotPassiveAtItsRateIsRefusedWithTheRateThatWouldDo) {
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
  EXPECT_EQ(law.error().message.find("Hz,"), std::string::npos) << law.error().message;
  scene.force_law.axis = ToolAxis::kAuto;
  EXPECT_TRUE(CuttingForceLaw::make({scene, device, hard.sheets, 250, {}, {}}));
}

}  // namespace
}  // namespace trocar::runtime
