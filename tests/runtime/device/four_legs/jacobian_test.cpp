// SPDX-License-Identifier: Apache-2.0
#include "runtime/device/four_legs/kinematics.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "runtime/device/four_legs/mechanism_limits.h"
#include "tests/reference/decompositions/decompositions.h"
#include "tests/reference/mechanism/influence_jacobian.h"
#include "tests/reference/mechanism/joint_limits.h"
#include "tests/support/device_workspace.h"

namespace trocar::runtime {
namespace {

using testing_support::Random;
using testing_support::random_workspace_pose;
using testing_support::Workspace;

// Motor rates by central differences of the inverse kinematics: the plate is moved along each axis
// of {B} and rotated about each axis through its own origin.
Jacobian by_differences(const DeviceDescription& device, const Pose& T) {
  constexpr double kStep = 2e-7;
  Jacobian G;
  for (int column = 0; column < 6; ++column) {
    Pose plus = T, minus = T;
    Eigen::Vector3d along = Eigen::Vector3d::Zero();
    along[column % 3] = kStep;
    if (column < 3) {
      plus.p_m += along;
      minus.p_m -= along;
    } else {
      plus.q = Eigen::AngleAxisd(kStep, along / kStep) * T.q;
      minus.q = Eigen::AngleAxisd(-kStep, along / kStep) * T.q;
    }
    G.col(column) = (motor_angles(inverse_kinematics(device, plus).joints) -
                     motor_angles(inverse_kinematics(device, minus).joints)) /
                    (2 * kStep);
  }
  return G;
}

TEST(Jacobian, AgreesWithCentralDifferencesAndInfluenceCoefficients) {
  const DeviceDescription device = default_device_description();
  Random random(11);
  double worst_difference = 0, worst_influence = 0;
  for (int n = 0; n < 100'000; ++n) {
    const Pose T = random_workspace_pose(random);
    const InverseResult inverse = inverse_kinematics(device, T);
    ASSERT_TRUE(inverse.status);
    const JacobianResult compact = jacobian(device, T, inverse.joints);
    const JacobianResult influence = influence_jacobian(device, T, inverse.joints);
    ASSERT_TRUE(compact.status);
    ASSERT_TRUE(influence.status);
    const double size = compact.G.cwiseAbs().maxCoeff();
    worst_influence =
        std::max(worst_influence, (compact.G - influence.G).cwiseAbs().maxCoeff() / size);
    worst_difference = std::max(
        worst_difference, (compact.G - by_differences(device, T)).cwiseAbs().maxCoeff() / size);
  }
  EXPECT_LT(worst_difference, 1e-7);
  EXPECT_LT(worst_influence, 1e-11) << "two closed forms may differ by rounding only";
}

// Row by row, since the largest entry of the matrix would hide the error of a small row.
TEST(Jacobian, EveryRowAgreesRelativeToItself) {
  const DeviceDescription device = default_device_description();
  Random random(12);
  for (int n = 0; n < 2000; ++n) {
    const Pose T = random_workspace_pose(random);
    const InverseResult inverse = inverse_kinematics(device, T);
    const Jacobian G = jacobian(device, T, inverse.joints).G;
    const Jacobian influence = influence_jacobian(device, T, inverse.joints).G;
    const Jacobian differences = by_differences(device, T);
    for (int i = 0; i < kMotors; ++i) {
      EXPECT_LT((G.row(i) - influence.row(i)).norm(), 1e-11 * G.row(i).norm());
      EXPECT_LT((G.row(i) - differences.row(i)).norm(), 1e-7 * G.row(i).norm());
    }
  }
}

double inverse_condition(const Jacobian& G) {
  const SingularRange range = singular_range(G);
  return range.largest > 0 ? range.smallest / range.largest : 0;
}

TEST(Jacobian, SingularRangeOfADegenerateMatrix) {
  Jacobian flat = Jacobian::Ones();
  EXPECT_LT(inverse_condition(flat), 1e-6);
  EXPECT_EQ(inverse_condition(Jacobian::Zero()), 0);
  flat(3, 3) = std::nan("");
  EXPECT_EQ(inverse_condition(flat), 0);
}

// Matrices made from given singular values, the smallest down to rounding.
TEST(Jacobian, SmallestSingularValueIsFoundDownToRounding) {
  Random random(14);
  const auto orthonormal = [&](int size) -> Eigen::MatrixXd {
    const Eigen::MatrixXd any =
        Eigen::MatrixXd::NullaryExpr(size, size, [&] { return random.between(-1, 1); });
    return reference::orthogonal_factor(any);
  };
  for (int bits = 0; bits < 50; ++bits) {
    const double least = std::ldexp(1.0, -bits);
    for (int n = 0; n < 20; ++n) {
      Twist values;
      values << 1, random.between(least, 1), random.between(least, 1), random.between(least, 1),
          random.between(least, 1), least;
      Jacobian G = orthonormal(kMotors).leftCols<6>() * values.asDiagonal() * orthonormal(6);
      G.rightCols<3>() *= kCharacteristicLength_m;
      G *= 40;  // of the device's size
      EXPECT_NEAR(inverse_condition(G), least, least > 1e-3 ? 1e-13 : 1e-14);
    }
  }
}

// Far beyond the stated workspace, except where a chain is nearly stretched, since differences are
// inexact there.
TEST(Jacobian, AgreesInTheWholeReachOfTheLegs) {
  const DeviceDescription device = default_device_description();
  const Workspace wide = {.z_min_m = 0.05, .z_max_m = 0.24, .lateral_m = 0.08, .tilt_rad = 0.8};
  Random random(16);
  double worst_difference = 0, worst_influence = 0;
  int compared = 0, out_of_reach = 0;
  while (compared < 20'000) {
    const Pose T = random_workspace_pose(random, wide);
    const InverseResult inverse = inverse_kinematics(device, T);
    out_of_reach += !inverse.status;
    if (!inverse.status) continue;
    const JacobianResult compact = jacobian(device, T, inverse.joints);
    if (!compact.status ||
        measure_singularity(device, T, inverse.joints, compact.G).nearest_branch_m < 0.002)
      continue;
    ++compared;
    const JacobianResult influence = influence_jacobian(device, T, inverse.joints);
    const double size = compact.G.cwiseAbs().maxCoeff();
    worst_influence =
        std::max(worst_influence, (compact.G - influence.G).cwiseAbs().maxCoeff() / size);
    worst_difference = std::max(
        worst_difference, (compact.G - by_differences(device, T)).cwiseAbs().maxCoeff() / size);
  }
  EXPECT_LT(worst_difference, 1e-7);
  EXPECT_LT(worst_influence, 1e-10);
  EXPECT_GT(out_of_reach, 1000);
}

TEST(Jacobian, StatusNamesTheStretchedChain) {
  const DeviceDescription device = default_device_description();
  Pose T;
  T.p_m.z() = 0.15;
  const JointAngles joints = inverse_kinematics(device, T).joints;
  // The compact form takes C from the pose: put it in line with leg 1's first link.
  const DeviceGeometry& g = device.geometry;
  const double th1 = joints.theta_rad[0][0];
  Pose stretched;
  stretched.p_m = Eigen::Vector3d(g.R_B1_m - g.R_T_m, 0, g.z_A_m) +
                  (g.l1_m + g.l2_m) * Eigen::Vector3d(std::cos(th1), 0, std::sin(th1));
  const JacobianResult compact = jacobian(device, stretched, joints);
  EXPECT_EQ(compact.status.failure, KinematicsFailure::kSingular);
  EXPECT_EQ(compact.status.leg, 1);
  EXPECT_EQ(compact.status.joint, 1);
}

}  // namespace
}  // namespace trocar::runtime
