// SPDX-License-Identifier: Apache-2.0
// The pose errors that noisy encoders cause, against what the covariance predicts: e^T P^-1 e of
// six-dimensional Gaussian errors e with covariance P follows the chi-square law of six degrees
// of freedom.
#include "runtime/mechanism/pose_covariance.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "tests/support/device_workspace.h"

namespace trocar::runtime {
namespace {

using testing_support::Random;
using testing_support::random_workspace_pose;

constexpr int kCounts = 8192;
constexpr double kCount_rad = 2 * std::numbers::pi / kCounts;

enum class Encoders { kMotorsOnly, kWithPassive };

PoseCovarianceResult predicted(Encoders which, const DeviceDescription& device, const Pose& T,
                               const JointAngles& joints, double deviation_rad) {
  return which == Encoders::kMotorsOnly
             ? covariance_from_motors(device, T, joints, deviation_rad)
             : covariance_from_encoders(device, T, joints, deviation_rad);
}

ForwardResult found(Encoders which, const DeviceDescription& device, const Pose& T_last,
                    const std::array<double, kEncoders>& encoder_rad) {
  return which == Encoders::kMotorsOnly
             ? forward_kinematics_from_motors(device, motor_angles(encoder_rad), T_last)
             : forward_kinematics(device, encoder_rad);
}

double gaussian(Random& random) {
  return std::sqrt(-2 * std::log(1 - random.unit())) *
         std::cos(2 * std::numbers::pi * random.unit());
}

double chi_square_6(double x) {
  return 1 - std::exp(-x / 2) * (1 + x / 2 + x * x / 8);
}

/// e^T P^-1 e at random poses, noise(angle) being the encoder's answer; sorted.
template <typename Noise>
std::vector<double> distances(Encoders which, double deviation_rad, int poses, Noise&& noise) {
  const DeviceDescription device = default_device_description();
  Random random(which == Encoders::kMotorsOnly ? 31 : 32);
  std::vector<double> out;
  for (int n = 0; n < poses; ++n) {
    const Pose T = random_workspace_pose(random);
    const JointAngles joints = inverse_kinematics(device, T).joints;
    const PoseCovarianceResult P = predicted(which, device, T, joints, deviation_rad);
    EXPECT_TRUE(P.status);
    auto encoder_rad = encoder_angles(joints);
    for (double& angle : encoder_rad)
      angle = noise(random, angle);
    const ForwardResult forward = found(which, device, T, encoder_rad);
    EXPECT_TRUE(forward.status);
    Eigen::Matrix<double, 6, 1> error;
    error << forward.T_device_plate.p_m - T.p_m,
        rotation_vector(forward.T_device_plate.q * T.q.conjugate());
    out.push_back(error.dot(P.covariance.ldlt().solve(error)));
  }
  std::sort(out.begin(), out.end());
  return out;
}

class PoseCovariance : public testing::TestWithParam<Encoders> {};

TEST_P(PoseCovariance, GaussianNoiseOfOneCountFollowsTheChiSquareLaw) {
  constexpr int kPoses = 20'000;
  const auto d = distances(GetParam(), kCount_rad, kPoses, [](Random& random, double angle) {
    return angle + kCount_rad * gaussian(random);
  });
  double mean = 0, largest_gap = 0;
  for (int i = 0; i < kPoses; ++i) {
    mean += d[i] / kPoses;
    const double law = chi_square_6(d[i]);
    largest_gap = std::max({largest_gap, std::abs(law - static_cast<double>(i) / kPoses),
                            std::abs(law - (i + 1.0) / kPoses)});
  }
  std::printf("mean %.3f (6), Kolmogorov-Smirnov %.2f / sqrt(n)\n", mean,
              largest_gap * std::sqrt(kPoses));
  // Both at three in a thousand for a true law: the mean's deviation is sqrt(12 / n).
  EXPECT_NEAR(mean, 6, 3 * std::sqrt(12.0 / kPoses));
  EXPECT_LT(largest_gap * std::sqrt(kPoses), 1.8);
}

TEST_P(PoseCovariance, QuantisationStaysWithinThePrediction) {
  constexpr int kPoses = 20'000;
  const auto d =
      distances(GetParam(), quantisation_deviation_rad(kCounts), kPoses,
                [](Random&, double angle) { return std::round(angle / kCount_rad) * kCount_rad; });
  double mean = 0;
  for (const double each : d)
    mean += each / kPoses;
  const double p99 = d[kPoses * 99 / 100];
  std::printf("quantised: mean %.3f (6), 99 %% below %.2f (16.81), largest %.1f\n", mean, p99,
              d.back());
  // Uniform errors have the same covariance, hence the same mean, and lighter tails.
  EXPECT_NEAR(mean, 6, 3 * std::sqrt(12.0 / kPoses));
  EXPECT_LT(p99, 16.81);
}

// The prediction's gain against the functions' own answers: each encoder moved alone.
TEST_P(PoseCovariance, EqualsTheSumOverSingleEncoders) {
  const DeviceDescription device = default_device_description();
  Random random(33);
  constexpr double kStep_rad = 1e-5;
  for (int n = 0; n < 200; ++n) {
    const Pose T = random_workspace_pose(random);
    const JointAngles joints = inverse_kinematics(device, T).joints;
    Eigen::Matrix<double, 6, 6> sum = Eigen::Matrix<double, 6, 6>::Zero();
    for (int i = 0; i < kEncoders; ++i) {
      auto plus = encoder_angles(joints), minus = plus;
      plus[i] += kStep_rad;
      minus[i] -= kStep_rad;
      const Pose a = found(GetParam(), device, T, plus).T_device_plate;
      const Pose b = found(GetParam(), device, T, minus).T_device_plate;
      Eigen::Matrix<double, 6, 1> column;
      column << a.p_m - b.p_m, rotation_vector(a.q * b.q.conjugate());
      sum += (column / (2 * kStep_rad)) * (column / (2 * kStep_rad)).transpose();
    }
    const auto P = predicted(GetParam(), device, T, joints, 1).covariance;
    EXPECT_LT((P - sum).norm(), 1e-6 * P.norm());
  }
}

INSTANTIATE_TEST_SUITE_P(WithAndWithoutPassive, PoseCovariance,
                         testing::Values(Encoders::kMotorsOnly, Encoders::kWithPassive));

TEST(PoseCovarianceInputs, BadOnesAreRefused) {
  const DeviceDescription device = default_device_description();
  Pose T;
  T.p_m.z() = 0.15;
  const JointAngles joints = inverse_kinematics(device, T).joints;
  EXPECT_EQ(covariance_from_motors(device, T, joints, std::nan("")).status.failure,
            KinematicsFailure::kBadInput);
  T.p_m.x() = std::nan("");
  EXPECT_EQ(covariance_from_motors(device, T, joints, 1).status.failure,
            KinematicsFailure::kBadInput);
  EXPECT_EQ(quantisation_deviation_rad(0), 0);
  EXPECT_NEAR(quantisation_deviation_rad(kCounts), kCount_rad / std::sqrt(12.0), 1e-18);
}

}  // namespace
}  // namespace trocar::runtime
