// SPDX-License-Identifier: Apache-2.0
// The laws stated in runtime/device/four_legs/torque_allocation.h.
#include "runtime/device/four_legs/torque_allocation.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>

#include "runtime/device/four_legs/kinematics.h"
#include "tests/reference/decompositions/decompositions.h"
#include "tests/support/campaign.h"
#include "tests/support/device_workspace.h"

namespace trocar::runtime {
namespace {

using testing_support::Random;
using testing_support::random_workspace_pose;

Jacobian jacobian_at(const DeviceDescription& device, const Pose& T) {
  return jacobian(device, T, inverse_kinematics(device, T).joints).G;
}

// Force in N, with a moment in N*m of up to force times 0.05 m.
Wrench random_wrench(Random& random, double force_N) {
  Wrench wrench;
  wrench << force_N * random.direction(), force_N * 0.05 * random.in_ball();
  return wrench;
}

// Pseudo-inverse and null space by the SVD, independent of the QR of the implementation.
struct Reference {
  MotorVector minimum_norm;
  Eigen::Matrix<double, kMotors, 2> null_space;
};
Reference reference(const Jacobian& G, const Wrench& wrench) {
  return {reference::shortest_solution(G.transpose(), wrench),
          reference::svd(G.transpose()).V.rightCols<2>()};
}

MotorVector working_limits(const MotorVector& limit) {
  return (1 - kTorqueReserve) * limit;
}

MotorVector stiffness(const MotorVector& limit) {
  MotorVector out;
  for (int i = 0; i < kMotors; ++i)
    out[i] = limit.squaredNorm() / (kTorqueReserve * limit[i] * kTorqueReserve * limit[i]);
  return out;
}

// Law 5's minimum by enumeration of the 3^8 patterns of torques below, within or above their
// working limits. Each pattern is a linear system for the torques and the wrench's multipliers
// (KKT). The problem is strictly convex, so the solution that is consistent with its pattern is the
// minimum.
MotorVector by_enumeration(const Jacobian& G, const Wrench& wrench, const MotorVector& limit) {
  const MotorVector working = working_limits(limit), k = stiffness(limit);
  int patterns = 1;
  for (int i = 0; i < kMotors; ++i)
    patterns *= 3;
  for (int pattern = 0; pattern < patterns; ++pattern) {
    MotorVector weight = MotorVector::Ones(), pull = MotorVector::Zero(), sign;
    for (int i = 0, rest = pattern; i < kMotors; ++i, rest /= 3) {
      sign[i] = rest % 3 == 2 ? -1 : rest % 3;
      if (sign[i] != 0) {
        weight[i] += k[i];
        pull[i] = k[i] * sign[i] * working[i];
      }
    }
    // weight tau = pull + G multipliers, G^T tau = wrench.
    const Jacobian soft = weight.cwiseInverse().asDiagonal() * G;
    const MotorVector free = pull.cwiseQuotient(weight);
    const Eigen::Matrix<double, 6, 6> left = G.transpose() * soft;
    const Wrench multipliers = reference::solve(left, wrench - G.transpose() * free);
    MotorVector tau = free + soft * multipliers;
    bool agrees = true;
    for (int i = 0; i < kMotors && agrees; ++i) {
      const double slack = 1e-9 * limit[i];
      agrees = sign[i] == 0 ? std::abs(tau[i]) <= working[i] + slack
                            : sign[i] * tau[i] >= working[i] - slack;
    }
    if (agrees) return tau;
  }
  ADD_FAILURE() << "no pattern fits";
  return MotorVector::Zero();
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

TEST(TorqueAllocation, WithinTheLimitsItIsThePseudoInverse) {
  const DeviceDescription device = default_device_description();
  Random random(21);
  double worst = 0;
  for (int n = 0; n < 20'000; ++n) {
    const Jacobian G = jacobian_at(device, random_workspace_pose(random));
    const Wrench wanted = random_wrench(random, random.between(0, 15));
    const AllocationResult result = allocate_torques(G, wanted, device.motor_peak_torque_Nm);
    if (result.kind != AllocationKind::kMinimumNorm) continue;
    ASSERT_EQ(result.scale, 1);
    ASSERT_FALSE(result.limited());
    worst = std::max(worst, (result.wrench_device - wanted).norm() / wanted.norm());
    expect_law_1_and_2(result, G, wanted, MotorVector::Constant(6));
    if (n % 20 == 0) {
      const MotorVector expected = reference(G, wanted).minimum_norm;
      ASSERT_LT((result.tau_motor_Nm - expected).norm(), 1e-11 * (1 + expected.norm()));
    }
    // Wider limits give the same bits.
    const AllocationResult wide = allocate_torques(G, wanted, 1e6);
    ASSERT_EQ(wide.tau_motor_Nm, result.tau_motor_Nm);
  }
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
    ASSERT_EQ(result.kind, AllocationKind::kMinimumNorm);
    ASSERT_LE((result.wrench_device - wanted).norm(), 1e-9 * wanted.norm());
  }
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

MotorVector random_limits(Random& random, int n) {
  MotorVector limit = MotorVector::Constant(6);
  if (n % 3 == 0) {  // motors may differ
    for (double& each : limit)
      each = random.between(1, 6);
  }
  return limit;
}

// Every fourth pose upright and near the middle, where rows of the null space are nearly parallel.
Pose random_pose(Random& random, int n) {
  Pose T = random_workspace_pose(random);
  if (n % 4 == 1) {
    T.p_m.head<2>() *= 0.01 * random.unit();
    T.q = from_rotation_vector(1e-3 * random.unit() * random.in_ball());
  }
  return T;
}

// Laws 1 to 4 at random poses, wrenches and limits.
TEST(TorqueAllocation, DeliversTheWantedWrenchOrTheLargestFeasibleScale) {
  const DeviceDescription device = default_device_description();
  const int count = test::campaign(10'000);
  Random random(23);
  int by_kind[4] = {0, 0, 0, 0};
  double worst_residual = 0;
  for (int n = 0; n < count; ++n) {
    const Jacobian G = jacobian_at(device, random_pose(random, n));
    const Wrench wanted = random_wrench(random, random.between(20, 150));
    const MotorVector limit = random_limits(random, n), working = working_limits(limit);
    const AllocationResult result = allocate_torques(G, wanted, limit);
    ++by_kind[static_cast<int>(result.kind)];
    expect_law_1_and_2(result, G, wanted, limit);
    worst_residual =
        std::max(worst_residual, (result.wrench_device - result.scale * wanted).norm());
    const Reference expected = reference(G, wanted);
    const MotorVector excess = expected.minimum_norm.cwiseAbs() - working;
    if (result.kind == AllocationKind::kMinimumNorm) {
      ASSERT_LE(excess.maxCoeff(), 1e-9);
      ASSERT_LT((result.tau_motor_Nm - expected.minimum_norm).norm(), 1e-10);
      ASSERT_EQ(result.scale, 1);
      continue;
    }
    ASSERT_GE(excess.maxCoeff(), -1e-9);
    ASSERT_NEAR(result.scale, largest_scale(expected.minimum_norm, expected.null_space, working),
                1e-7);
    ASSERT_EQ(result.kind == AllocationKind::kScaled, result.scale < 1);
    ASSERT_EQ(result.limited(), result.scale < 1);
  }
  EXPECT_GT(by_kind[0], count / 60);
  EXPECT_GT(by_kind[1], count / 60);
  EXPECT_GT(by_kind[2], count / 60);
  EXPECT_EQ(by_kind[3], 0);
  EXPECT_LT(worst_residual, 1e-9);
}

// Law 5.
TEST(TorqueAllocation, AgreesWithTheEnumeratedOptimum) {
  const DeviceDescription device = default_device_description();
  const int count = test::campaign(300);
  Random random(26);
  int compared = 0, over_working = 0;
  double worst = 0;
  for (int n = 0; compared < count; ++n) {
    const Jacobian G = jacobian_at(device, random_pose(random, n));
    const Wrench direction = random_wrench(random, 1);
    const MotorVector limit = random_limits(random, n);
    // Half of them near the boundary of the feasible wrenches, the others far inside and beyond.
    const double max_N = 1e6 * allocate_torques(G, 1e6 * direction, limit).scale;
    const Wrench wanted =
        max_N * (n % 2 == 0 ? random.between(0.4, 1.5) : random.between(0.95, 1.05)) * direction;
    const AllocationResult result = allocate_torques(G, wanted, limit);
    if (result.kind == AllocationKind::kMinimumNorm) continue;
    ++compared;
    const MotorVector expected = by_enumeration(G, result.scale * wanted, limit);
    worst = std::max(worst, (result.tau_motor_Nm - expected).cwiseAbs().maxCoeff());
    over_working += ((result.tau_motor_Nm.cwiseAbs() - working_limits(limit)).array() > 0).any();
  }
  EXPECT_LT(worst, 1e-6);
  EXPECT_GT(over_working, count / 2);
}

// Law 6, around random points, most of them where torques change fastest, with steps from 10 N and
// 10 mm down to rounding. A jump would give a rate that grows without bound as the steps shrink.
// The rate is relative to the change of the minimum-norm torques and of the null space, by the SVD.
TEST(TorqueAllocation, TorquesChangeAtABoundedRate) {
  const DeviceDescription device = default_device_description();
  Random random(24);
  double fastest_fixed = 0;
  for (int n = 0; n < 1500; ++n) {
    const Pose T = random_pose(random, n);
    const Jacobian G = jacobian_at(device, T);
    const MotorVector limit = random_limits(random, n);
    const Wrench direction = random_wrench(random, 1);
    const double max_N = 1e6 * allocate_torques(G, 1e6 * direction, limit).scale;
    const double share = n % 2 == 0 ? random.between(0.2, 2) : random.between(0.98, 1.01);
    const Wrench wanted = share * max_N * direction;
    const AllocationResult result = allocate_torques(G, wanted, limit);
    const Reference here = reference(G, wanted);
    const double largest_stiffness = stiffness(limit).maxCoeff();
    const double K =
        (2 + 1.5 * std::sqrt(largest_stiffness)) * (1 + limit.norm() / limit.minCoeff());
    const double K_fixed = std::sqrt(1 + largest_stiffness / 4);
    if (limit == MotorVector::Constant(6)) {
      ASSERT_LT(K_fixed, 142);
    }

    for (const double size : {1.0, 1e-1, 1e-2, 1e-3, 1e-4, 1e-5}) {
      // The wrench alone.
      Wrench step;
      step << 10 * size * random.direction(), size * random.direction();
      const AllocationResult moved = allocate_torques(G, wanted + step, limit);
      const double jump = (moved.tau_motor_Nm - result.tau_motor_Nm).norm();
      const double dc = (reference(G, wanted + step).minimum_norm - here.minimum_norm).norm();
      ASSERT_LE(jump, K * dc + 1e-9);
      if (result.scale == 1 && moved.scale == 1) {
        ASSERT_LE(jump, K_fixed * dc + 1e-9);
        fastest_fixed = std::max(fastest_fixed, jump / dc);
      }

      // And the pose with it.
      Pose near = T;
      near.p_m += 0.01 * size * random.direction();
      near.q = from_rotation_vector(0.1 * size * random.direction()) * T.q;
      const Jacobian G_near = jacobian_at(device, near);
      const Reference there = reference(G_near, wanted + step);
      const double dP =
          reference::singular_values(there.null_space * there.null_space.transpose() -
                                     here.null_space * here.null_space.transpose())[0];
      const double change = (there.minimum_norm - here.minimum_norm).norm() + limit.norm() * dP;
      const double both =
          (allocate_torques(G_near, wanted + step, limit).tau_motor_Nm - result.tau_motor_Nm)
              .norm();
      ASSERT_LE(both, K * change + 1e-9);
    }
  }
  EXPECT_GT(fastest_fixed, 5) << "too slow to test the bound";
}

// While the wrench grows, the scale never rises, and beyond the limits the torques stay constant.
TEST(TorqueAllocation, TorquesStayConstantBeyondTheLimits) {
  const DeviceDescription device = default_device_description();
  Random random(27);
  for (int n = 0; n < 60; ++n) {
    const Jacobian G = jacobian_at(device, random_pose(random, n));
    const Wrench direction = random_wrench(random, 1);
    AllocationResult last = allocate_torques(G, Wrench::Zero(), 6.0);
    for (int step = 1; step <= 600; ++step) {
      const AllocationResult result = allocate_torques(G, 0.5 * step * direction, 6.0);
      ASSERT_LE(result.scale, last.scale);
      if (last.scale < 1) {
        ASSERT_LT((result.tau_motor_Nm - last.tau_motor_Nm).norm(), 1e-6);
      }
      last = result;
    }
    EXPECT_LT(last.scale, 1);
    // The scale is not smaller than necessary: some motor is at or above its working limit.
    EXPECT_GE(last.tau_motor_Nm.cwiseAbs().maxCoeff(), 6 * (1 - kTorqueReserve) - 1e-9);
  }
}

// Numbers of all sizes and those that are not finite: tests/corpus/device.
TEST(TorqueAllocation, RefusesASingularJacobianAndALimitThatIsNotPositive) {
  Random random(25);
  const Jacobian G = jacobian_at(default_device_description(), random_workspace_pose(random));
  Jacobian flat = G;
  flat.col(4) = 2 * flat.col(1);
  const Wrench wanted = random_wrench(random, 10);
  for (const AllocationResult& result :
       {allocate_torques(flat, wanted, 6.0), allocate_torques(Jacobian::Zero(), wanted, 6.0),
        allocate_torques(G, wanted, 0.0), allocate_torques(G, wanted, -1.0)}) {
    EXPECT_EQ(result.kind, AllocationKind::kRefused);
    EXPECT_TRUE(result.limited());
    EXPECT_EQ(result.tau_motor_Nm, MotorVector::Zero());
    EXPECT_EQ(result.scale, 0);
  }
}

}  // namespace
}  // namespace trocar::runtime
