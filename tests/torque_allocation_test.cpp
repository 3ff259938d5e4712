// SPDX-License-Identifier: Apache-2.0
// The numbered laws of runtime/device/torque_allocation.h.
#include "runtime/device/torque_allocation.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "runtime/device/jacobian.h"
#include "tests/device_workspace.h"

namespace trocar::runtime {
namespace {

using testing_support::Random;
using testing_support::random_workspace_pose;

Jacobian jacobian_at(const DeviceDescription& device, const Pose& T) {
  return jacobian(device, T, inverse_kinematics(device, T).joints).G;
}

// Force in N with moment in N*m of a plate's size beside it.
Wrench random_wrench(Random& random, double force_N) {
  Wrench wrench;
  wrench << force_N * random.direction(), force_N * 0.05 * random.in_ball();
  return wrench;
}

// An independent route to the pseudo-inverse and the null space: the SVD.
struct Reference {
  MotorVector minimum_norm;
  Eigen::Matrix<double, kMotors, 2> null_space;
};
Reference reference(const Jacobian& G, const Wrench& wrench) {
  const Eigen::JacobiSVD<Eigen::MatrixXd> svd(G.transpose(),
                                              Eigen::ComputeFullU | Eigen::ComputeFullV);
  return {svd.solve(wrench), svd.matrixV().rightCols<2>()};
}

void expect_law_1_and_2(const AllocationResult& result, const Jacobian& G, const Wrench& wanted,
                        const MotorVector& limit) {
  for (int i = 0; i < kMotors; ++i)
    ASSERT_LE(std::abs(result.tau_motor_Nm[i]), limit[i]);
  ASSERT_GE(result.scale, 0);
  ASSERT_LE(result.scale, 1);
  const Wrench delivered = G.transpose() * result.tau_motor_Nm;
  ASSERT_LE((delivered - result.scale * wanted).norm(), 1e-9 * result.scale * wanted.norm());
  ASSERT_EQ(delivered, result.wrench_device);
}

TEST(TorqueAllocation, InsideTheLimitsItIsThePseudoInverse) {
  const DeviceDescription device = default_device_description();
  Random random(21);
  double worst = 0;
  for (int n = 0; n < 20'000; ++n) {
    const Jacobian G = jacobian_at(device, random_workspace_pose(random));
    const Wrench wanted = random_wrench(random, random.between(0, 15));
    const AllocationResult result = allocate_torques(G, wanted, device.motor_peak_torque_Nm);
    if (result.kind != Allocation::kMinimumNorm) continue;
    ASSERT_EQ(result.scale, 1);
    ASSERT_FALSE(result.limited());
    worst = std::max(worst, (result.wrench_device - wanted).norm() / wanted.norm());
    expect_law_1_and_2(result, G, wanted, MotorVector::Constant(6));
    if (n % 20 == 0) {
      const MotorVector expected = reference(G, wanted).minimum_norm;
      ASSERT_LT((result.tau_motor_Nm - expected).norm(), 1e-11 * (1 + expected.norm()));
    }
    // Wider limits change nothing, to the bit.
    const AllocationResult wide = allocate_torques(G, wanted, 1e6);
    ASSERT_EQ(wide.tau_motor_Nm, result.tau_motor_Nm);
  }
  std::printf("delivered against wanted within limits: %.1e relative\n", worst);
  EXPECT_LT(worst, 1e-9);
}

TEST(TorqueAllocation, ThirtyFiveNewtonsInAnyDirectionAreWithinThePeak) {
  const DeviceDescription device = default_device_description();
  Random random(22);
  for (int n = 0; n < 20'000; ++n) {
    const Jacobian G = jacobian_at(device, random_workspace_pose(random));
    Wrench wanted = Wrench::Zero();
    wanted.head<3>() = 35 * random.direction();
    const AllocationResult result = allocate_torques(G, wanted, device.motor_peak_torque_Nm);
    ASSERT_EQ(result.kind, Allocation::kMinimumNorm);
    ASSERT_LE((result.wrench_device - wanted).norm(), 1e-9 * wanted.norm());
  }
}

// Null-space coordinates of all corners of {y : |tau + N y| <= limit}, by trying
// every pair of active limits.
std::vector<Eigen::Vector2d> feasible_corners(const MotorVector& tau,
                                              const Eigen::Matrix<double, kMotors, 2>& N,
                                              const MotorVector& limit) {
  std::vector<Eigen::Vector2d> corners;
  for (int i = 0; i < kMotors; ++i) {
    for (int j = i + 1; j < kMotors; ++j) {
      for (int signs = 0; signs < 4; ++signs) {
        Eigen::Matrix2d rows;
        rows << N.row(i), N.row(j);
        const Eigen::Vector2d right((signs & 1 ? limit[i] : -limit[i]) - tau[i],
                                    (signs & 2 ? limit[j] : -limit[j]) - tau[j]);
        if (std::abs(rows.determinant()) < 1e-12) continue;
        const Eigen::Vector2d y = rows.inverse() * right;
        if (((tau + N * y).array().abs() <= limit.array() + 1e-9).all()) corners.push_back(y);
      }
    }
  }
  return corners;
}

// Largest feasible scale by trying every vertex (y, t) of the linear programme
// min t, |tau + N y| <= t limit.
double largest_scale(const MotorVector& tau, const Eigen::Matrix<double, kMotors, 2>& N,
                     const MotorVector& limit) {
  double least_load = std::numeric_limits<double>::infinity();
  for (int i = 0; i < kMotors; ++i) {
    for (int j = i + 1; j < kMotors; ++j) {
      for (int k = j + 1; k < kMotors; ++k) {
        for (int signs = 0; signs < 8; ++signs) {
          const int row[3] = {i, j, k};
          Eigen::Matrix3d left;
          Eigen::Vector3d right;
          for (int r = 0; r < 3; ++r) {
            const double sign = signs >> r & 1 ? 1 : -1;
            left.row(r) << N.row(row[r]), -sign * limit[row[r]];
            right[r] = -tau[row[r]];
          }
          if (std::abs(left.determinant()) < 1e-12) continue;
          const Eigen::Vector3d vertex = left.inverse() * right;
          const double load = vertex[2];
          const Eigen::Array<double, kMotors, 1> torque =
              (tau + N * vertex.head<2>()).array().abs();
          if (load >= 0 && (torque <= load * limit.array() + 1e-9).all()) {
            least_load = std::min(least_load, load);
          }
        }
      }
    }
  }
  return std::min(1.0, 1 / least_load);
}

TEST(TorqueAllocation, OutsideItTakesTheNearestFeasibleTorquesElseScales) {
  const DeviceDescription device = default_device_description();
  Random random(23);
  int by_kind[4] = {0, 0, 0, 0};
  double clipping_bends = 0;
  for (int n = 0; n < 6000; ++n) {
    const Jacobian G = jacobian_at(device, random_workspace_pose(random));
    const Wrench wanted = random_wrench(random, random.between(20, 150));
    MotorVector limit = MotorVector::Constant(6);
    if (n % 3 == 0) {  // motors need not be alike
      for (double& each : limit)
        each = random.between(1, 6);
    }
    const AllocationResult result = allocate_torques(G, wanted, limit);
    ++by_kind[static_cast<int>(result.kind)];
    expect_law_1_and_2(result, G, wanted, limit);
    const Reference expected = reference(G, wanted);
    if (result.kind == Allocation::kMinimumNorm) {
      ASSERT_LE((expected.minimum_norm.cwiseAbs() - limit).maxCoeff(), 1e-9);
      continue;
    }
    ASSERT_GE((expected.minimum_norm.cwiseAbs() - limit).maxCoeff(), -1e-9);

    ASSERT_NEAR(result.scale, largest_scale(expected.minimum_norm, expected.null_space, limit),
                1e-8);
    ASSERT_EQ(result.kind == Allocation::kScaled, result.scale < 1);
    ASSERT_EQ(result.limited(), result.scale < 1);

    // Nearest to the minimum-norm torques: y is the least-norm point of a convex
    // set exactly if y . (z - y) >= 0 for every corner z.
    const MotorVector least = result.scale * expected.minimum_norm;
    const Eigen::Vector2d y = expected.null_space.transpose() * (result.tau_motor_Nm - least);
    ASSERT_LT((least + expected.null_space * y - result.tau_motor_Nm).norm(), 1e-9);
    if (result.kind == Allocation::kNullSpace) {
      const auto corners = feasible_corners(least, expected.null_space, limit);
      ASSERT_FALSE(corners.empty());
      for (const Eigen::Vector2d& z : corners)
        ASSERT_GE(y.dot(z - y), -1e-8);
    }
    // What clipping would have done.
    const Wrench clipped =
        G.transpose() * MotorVector(expected.minimum_norm.cwiseMin(limit).cwiseMax(-limit));
    const double cosine = clipped.head<3>().normalized().dot(wanted.head<3>().normalized());
    clipping_bends = std::max(clipping_bends, std::acos(std::clamp(cosine, -1.0, 1.0)));
  }
  std::printf("minimum norm %d, null space %d, scaled %d; clipping would bend by up to %.0f deg\n",
              by_kind[0], by_kind[1], by_kind[2], clipping_bends * 180 / std::numbers::pi);
  EXPECT_GT(by_kind[0], 100);
  EXPECT_GT(by_kind[1], 100);
  EXPECT_GT(by_kind[2], 100);
  EXPECT_EQ(by_kind[3], 0);
  EXPECT_GT(clipping_bends, 0.1) << "these wrenches do not tell clipping from allocating";
}

// Along a ray of growing wrenches the torques move without jumps through all
// three regimes, and past the limit they no longer move at all. Close to the end
// of feasibility they may move fast, so steps that look like jumps are divided.
TEST(TorqueAllocation, TorquesAreContinuousInTheWrench) {
  const DeviceDescription device = default_device_description();
  Random random(24);
  constexpr double kStep_N = 0.1;
  constexpr int kDivisions = 1000;
  int divided = 0;
  double steepest = 0;
  for (int n = 0; n < 60; ++n) {
    const Jacobian G = jacobian_at(device, random_workspace_pose(random));
    const Wrench direction = random_wrench(random, 1);
    AllocationResult last = allocate_torques(G, Wrench::Zero(), 6.0);
    for (int step = 1; step <= 3000; ++step) {
      const double force_N = step * kStep_N;
      const AllocationResult result = allocate_torques(G, force_N * direction, 6.0);
      const double moved = (result.tau_motor_Nm - last.tau_motor_Nm).norm();
      ASSERT_LE(result.scale, last.scale);
      if (last.scale < 1) {
        ASSERT_LT(moved, 1e-6);
      } else if (moved > 0.1) {
        ++divided;
        MotorVector before = last.tau_motor_Nm;
        for (int i = 1; i <= kDivisions; ++i) {
          const double between_N = force_N - kStep_N + i * (kStep_N / kDivisions);
          const MotorVector tau = allocate_torques(G, between_N * direction, 6.0).tau_motor_Nm;
          steepest = std::max(steepest, (tau - before).norm() / (kStep_N / kDivisions));
          ASSERT_LT((tau - before).norm(), 0.05) << between_N;
          before = tau;
        }
      }
      last = result;
    }
    EXPECT_LT(last.scale, 1);
    // On the boundary some motor is at its limit: the scale is not timid.
    EXPECT_NEAR(last.tau_motor_Nm.cwiseAbs().maxCoeff(), 6, 1e-8);
  }
  std::printf("steps divided: %d of %d; steepest: %.0f N*m per N\n", divided, 60 * 3000, steepest);
}

TEST(TorqueAllocation, ExtremeAndBadInputs) {
  const DeviceDescription device = default_device_description();
  Random random(25);
  const Jacobian G = jacobian_at(device, random_workspace_pose(random));
  const MotorVector limit = MotorVector::Constant(6);
  for (const double force_N : {1e-300, 1e-12, 1e3, 1e6, 1e12, 1e100}) {
    const Wrench wanted = random_wrench(random, force_N);
    expect_law_1_and_2(allocate_torques(G, wanted, 6.0), G, wanted, limit);
  }
  const AllocationResult none = allocate_torques(G, Wrench::Zero(), 6.0);
  EXPECT_EQ(none.kind, Allocation::kMinimumNorm);
  EXPECT_EQ(none.tau_motor_Nm, MotorVector::Zero());

  const auto expect_refused = [](const AllocationResult& result) {
    EXPECT_EQ(result.kind, Allocation::kRefused);
    EXPECT_TRUE(result.limited());
    EXPECT_EQ(result.tau_motor_Nm, MotorVector::Zero());
    EXPECT_EQ(result.scale, 0);
  };
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  constexpr double kInf = std::numeric_limits<double>::infinity();
  const Wrench wanted = random_wrench(random, 10);
  for (const double bad : {kNan, kInf}) {
    Wrench bad_wrench = wanted;
    bad_wrench[4] = bad;
    expect_refused(allocate_torques(G, bad_wrench, 6.0));
    Jacobian bad_G = G;
    bad_G(7, 5) = bad;
    expect_refused(allocate_torques(bad_G, wanted, 6.0));
    expect_refused(allocate_torques(G, wanted, bad));
  }
  expect_refused(allocate_torques(G, wanted, 0.0));
  expect_refused(allocate_torques(G, wanted, -1.0));
  Jacobian flat = G;
  flat.col(4) = 2 * flat.col(1);
  expect_refused(allocate_torques(flat, wanted, 6.0));
  expect_refused(allocate_torques(Jacobian::Zero(), wanted, 6.0));
}

}  // namespace
}  // namespace trocar::runtime
