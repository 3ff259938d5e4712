// SPDX-License-Identifier: Apache-2.0
#include "runtime/device/four_legs/kinematics.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "tests/reference/mechanism/joint_limits.h"
#include "tests/reference/mechanism/leg_assemblies.h"
#include "tests/support/device_workspace.h"

namespace trocar::runtime {
namespace {

using Eigen::Vector3d;
using testing_support::Random;
using testing_support::random_workspace_pose;

constexpr int kPoses = 100'000;
constexpr double kDeg = std::numbers::pi / 180;

double angle_between(const Pose& a, const Pose& b) {
  return rotation_vector(a.q * b.q.conjugate()).norm();
}

TEST(Kinematics, InverseSatisfiesBothChains) {
  const DeviceDescription device = default_device_description();
  const DeviceGeometry& g = device.geometry;
  Random random(1);
  for (int n = 0; n < kPoses; ++n) {
    const Pose T = random_workspace_pose(random);
    const InverseResult inverse = inverse_kinematics(device, T);
    ASSERT_TRUE(inverse.status) << "pose " << n;
    ASSERT_TRUE(all_joints_within_limits(device, inverse.joints)) << "pose " << n;
    for (int m = 0; m < kLegs; ++m) {
      const auto& th = inverse.joints.theta_rad[m];
      // Both chains computed with rotation matrices instead of the functions of leg.h.
      const Eigen::Matrix3d leg = Eigen::AngleAxisd(m * 90 * kDeg, Vector3d::UnitZ()).matrix();
      const Vector3d C = T.p_m + T.q * (leg * Vector3d(g.R_T_m, 0, 0));
      const auto upper = [&](double a) { return Vector3d(std::cos(a), 0, std::sin(a)); };
      const auto lower = [&](double a) { return Vector3d(std::cos(a), std::sin(a), 0); };
      const Vector3d E = Vector3d(g.R_B1_m, 0, g.z_A_m) + g.l1_m * upper(th[0]);
      const Vector3d C_chain =
          E + g.l2_m * (std::cos(th[2]) * upper(th[0] + th[1]) + Vector3d(0, std::sin(th[2]), 0));
      EXPECT_LT((leg * C_chain - C).norm(), 1e-13);
      const Vector3d D = E + g.l5_m / g.l2_m * (C_chain - E);
      const Vector3d D_chain =
          Vector3d(g.R_B2_m * std::cos(g.d_rad), g.R_B2_m * std::sin(g.d_rad), g.z_A_m - g.H_B_m) +
          g.l3_m * lower(th[3]) +
          g.l4_m * (std::cos(th[5]) * lower(th[3] + th[4]) + Vector3d(0, 0, std::sin(th[5])));
      EXPECT_LT((D_chain - D).norm(), 1e-13);
    }
  }
}

TEST(Kinematics, ForwardFromPassiveEncodersReturnsThePose) {
  const DeviceDescription device = default_device_description();
  Random random(2);
  double worst_m = 0, worst_rad = 0;
  for (int n = 0; n < kPoses; ++n) {
    const Pose T = random_workspace_pose(random);
    const InverseResult inverse = inverse_kinematics(device, T);
    ASSERT_TRUE(inverse.status);
    const ForwardResult forward = forward_kinematics(device, encoder_angles(inverse.joints));
    ASSERT_TRUE(forward.status);
    EXPECT_LT(forward.residual_m, 1e-12);
    worst_m = std::max(worst_m, (forward.T_device_plate.p_m - T.p_m).norm());
    worst_rad = std::max(worst_rad, angle_between(forward.T_device_plate, T));
  }
  EXPECT_LT(worst_m, 1e-10);
  EXPECT_LT(worst_rad, 1e-10);
}

// Compared with Eigen's general Umeyama fit, for encoders that contradict each other.
TEST(Kinematics, ForwardIsTheLeastSquaresFit) {
  const DeviceDescription device = default_device_description();
  Random random(3);
  for (int n = 0; n < 2000; ++n) {
    const Pose T = random_workspace_pose(random);
    auto encoders = encoder_angles(inverse_kinematics(device, T).joints);
    for (double& angle : encoders)
      angle += random.between(-0.02, 0.02);
    const ForwardResult forward = forward_kinematics(device, encoders);
    ASSERT_TRUE(forward.status);

    Eigen::Matrix<double, 3, kLegs> plate, measured;
    for (int m = 0; m < kLegs; ++m) {
      plate.col(m) = leg::plate_joint(device.geometry, m);
      measured.col(m) = leg::from_leg(
          m, leg::upper_tip(device.geometry, encoders[encoder_index(m, 0)],
                            encoders[encoder_index(m, 1)], encoders[encoder_index(m, 2)]));
    }
    const Eigen::Matrix4d fit = Eigen::umeyama(plate, measured, false);
    EXPECT_LT((fit.topRightCorner<3, 1>() - forward.T_device_plate.p_m).norm(), 1e-12);
    EXPECT_LT((fit.topLeftCorner<3, 3>() - forward.T_device_plate.q.matrix()).norm(), 1e-11);
    const double residual = std::sqrt(((fit.topLeftCorner<3, 3>() * plate).colwise() +
                                       Vector3d(fit.topRightCorner<3, 1>()) - measured)
                                          .squaredNorm() /
                                      kLegs);
    EXPECT_NEAR(forward.residual_m, residual, 1e-12);
    EXPECT_GT(forward.residual_m, 1e-5) << "noise must raise the residual";
  }
}

TEST(Kinematics, InverseGivesTheDescribedOneOfAllAssemblies) {
  const DeviceDescription device = default_device_description();
  Random random(7);
  for (int n = 0; n < 300; ++n) {
    const Pose T = random_workspace_pose(random);
    const InverseResult chosen = inverse_kinematics(device, T);
    for (int m = 0; m < kLegs; ++m)
      EXPECT_EQ(leg_assemblies(device, T, m)[0].theta_rad, chosen.joints.theta_rad[m]);
    // A device described with the other branch of theta4.
    DeviceDescription other = device;
    other.geometry.branch_theta4 = -1;
    const InverseResult mirrored = inverse_kinematics(other, T);
    ASSERT_TRUE(mirrored.status);
    for (int m = 0; m < kLegs; ++m)
      EXPECT_EQ(mirrored.joints.theta_rad[m], leg_assemblies(other, T, m)[1].theta_rad);
  }
}

TEST(Kinematics, JointLimitsAreCheckedAtBothEnds) {
  const DeviceDescription device = default_device_description();
  Pose T;
  T.p_m.z() = 0.15;
  const JointAngles inside = inverse_kinematics(device, T).joints;
  EXPECT_TRUE(check_joint_limits(device, encoder_angles(inside)));
  for (int m = 0; m < kLegs; ++m) {
    for (int j = 0; j < static_cast<int>(kJointsPerLeg); ++j) {
      const JointLimit& limit = device.joint_limit[j];
      for (const double at :
           {limit.min_rad - 1e-6, limit.max_rad + 1e-6, std::numeric_limits<double>::quiet_NaN()}) {
        JointAngles joints = inside;
        joints.theta_rad[m][j] = at;
        EXPECT_FALSE(all_joints_within_limits(device, joints));
        const KinematicsStatus status = check_joint_limits(device, encoder_angles(joints));
        if (j >= 4) {  // no encoder
          EXPECT_TRUE(status);
          continue;
        }
        EXPECT_EQ(status.failure, KinematicsFailure::kBeyondLimit);
        EXPECT_EQ(status.leg, m + 1);
        EXPECT_EQ(status.joint, j + 1);
      }
      JointAngles near = inside;
      near.theta_rad[m][j] = limit.max_rad - 0.01;
      EXPECT_TRUE(check_joint_limits(device, encoder_angles(near)));
    }
  }
}

TEST(Kinematics, RotationFromZIsTheShortestThatReachesTheDirection) {
  Random random(7);
  for (int i = 0; i < 10'000; ++i) {
    Vector3d d = random.direction();
    if (i % 3 == 1) d.head<2>() *= 1e-9;  // almost parallel to z, both ways
    d.normalize();
    const Eigen::Quaterniond q = rotation_from_z(d);
    ASSERT_NEAR(q.norm(), 1, 1e-14);
    ASSERT_LT((q * Vector3d::UnitZ() - d).norm(), 1e-15 * 4) << d.transpose();
    const double angle = std::atan2(d.head<2>().norm(), d.z());
    ASSERT_NEAR(rotation_vector(q).norm(), angle, 1e-14);
    if (d.z() < -0.9) continue;  // Eigen's method loses digits there
    const auto eigens = Eigen::Quaterniond::FromTwoVectors(Vector3d::UnitZ(), d);
    ASSERT_LT((q.coeffs() - eigens.coeffs()).norm(), 1e-14);
  }
  EXPECT_EQ(rotation_from_z(Vector3d::UnitZ()).coeffs(), Eigen::Quaterniond::Identity().coeffs());
  EXPECT_EQ(rotation_from_z(-Vector3d::UnitZ()) * Vector3d::UnitZ(), -Vector3d::UnitZ());
}

TEST(Kinematics, RotationVectorsConvertBothWays) {
  Random random(5);
  for (const double length : {0.0, 1e-13, 1e-9, 1e-6, 1e-3, 1.0, 3.0}) {
    const Vector3d r = length * random.direction();
    EXPECT_LT((rotation_vector(from_rotation_vector(r)) - r).norm(), 1e-14 + 1e-14 * length);
    const Eigen::Quaterniond q = from_rotation_vector(r);
    const Eigen::Quaterniond negative(-q.w(), -q.x(), -q.y(), -q.z());
    EXPECT_LT((rotation_vector(negative) - r).norm(), 1e-14 + 1e-14 * length);
    if (length > 0) {
      const Eigen::AngleAxisd expected(length, r / length);
      EXPECT_LT((q.matrix() - expected.matrix()).norm(), 1e-14);
    }
  }
}

}  // namespace
}  // namespace trocar::runtime
