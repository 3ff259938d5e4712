// SPDX-License-Identifier: Apache-2.0
#include "runtime/device/four_legs/mechanism_limits.h"

#include <gtest/gtest.h>

#include <cmath>

#include "runtime/device/four_legs/kinematics.h"
#include "runtime/realtime/realtime_thread.h"
#include "tests/reference/decompositions/decompositions.h"
#include "tests/support/counted_allocations.h"
#include "tests/support/device_workspace.h"

namespace trocar::runtime {
namespace {

using Eigen::Vector3d;
using testing_support::Random;
using testing_support::random_workspace_pose;
using testing_support::Workspace;

constexpr Workspace kWide = {.z_min_m = 0.05, .z_max_m = 0.24, .lateral_m = 0.08, .tilt_rad = 0.8};

struct Solved {
  Pose T;
  JointAngles joints;
  Jacobian G;
};
Solved random_solved(Random& random, const DeviceDescription& device, const Workspace& workspace) {
  for (;;) {
    const Pose T = random_workspace_pose(random, workspace);
    const InverseResult inverse = inverse_kinematics(device, T);
    if (!inverse.status) continue;
    const JacobianResult motion = jacobian(device, T, inverse.joints);
    if (motion.status) return {T, inverse.joints, motion.G};
  }
}

TEST(Singularity, SmallestSingularValueIsThatOfTheWeakestDirection) {
  const DeviceDescription device = default_device_description();
  Random random(41);
  for (int n = 0; n < 1000; ++n) {
    const Solved at = random_solved(random, device, kWide);
    const Singularity s = measure_singularity(device, at.T, at.joints, at.G);
    Jacobian scaled = at.G;
    scaled.rightCols<3>() /= kCharacteristicLength_m;
    const reference::Svd svd = reference::svd(scaled);
    const double largest = svd.singular_values[0], smallest = svd.singular_values[5];
    EXPECT_NEAR(s.smallest_singular_value_per_m, smallest, 1e-12 * largest);
    EXPECT_NEAR(s.inverse_condition, smallest / largest, 1e-12);
    // Duality: torques of norm 1 N*m resist this many N in the weakest direction.
    Wrench weakest = svd.V.col(5);
    weakest.tail<3>() *= kCharacteristicLength_m;
    const AllocationResult result = allocate_torques(at.G, weakest, 1e9);
    if (smallest > 1e-4 * largest) {
      ASSERT_EQ(result.kind, AllocationKind::kMinimumNorm);
      EXPECT_NEAR(result.tau_motor_Nm.norm() * s.smallest_singular_value_per_m, 1, 1e-3);
    }
  }
}

// The end point is moved in random directions. It stays within the chain's reach for moves of the
// distance, and for most chains leaves it in some direction for moves 1.2 times as long.
TEST(Singularity, BranchDistanceIsTheLargestSafeMove) {
  const DeviceDescription device = default_device_description();
  const DeviceGeometry& g = device.geometry;
  Random random(42);
  int near = 0, tight = 0;
  for (int n = 0; n < 300; ++n) {
    const Solved at = random_solved(random, device, kWide);
    const Singularity s = measure_singularity(device, at.T, at.joints, at.G);
    double least_m = 1;
    for (int m = 0; m < kLegs; ++m) {
      const Vector3d C = leg::to_leg(m, at.T * leg::plate_joint(g, m));
      const Vector3d D = leg::link_joint(g, leg::elbow(g, at.joints.theta_rad[m][0]), C);
      const auto reaches = [](const Vector3d& p, double a, double b) {
        // Whether links a (in the x-y plane) and b span p: a scan of the first one's angle.
        double lowest = 1e9, highest = -1e9;
        for (int i = 0; i < 720; ++i) {
          const double angle = i * std::numbers::pi / 360;
          const double d = (p - a * Vector3d(std::cos(angle), std::sin(angle), 0)).norm();
          lowest = std::min(lowest, d);
          highest = std::max(highest, d);
        }
        return lowest <= b && b <= highest;
      };
      const Vector3d p = C - leg::upper_motor(g), q = D - leg::lower_motor(g);
      const Vector3d chains[2] = {{p.x(), p.z(), p.y()}, q};
      const double links[2][2] = {{g.l1_m, g.l2_m}, {g.l3_m, g.l4_m}};
      const double measured_m[2] = {s.branch[m].theta1_m, s.branch[m].theta4_m};
      for (int c = 0; c < 2; ++c) {
        least_m = std::min(least_m, measured_m[c]);
        ASSERT_GT(measured_m[c], 0);
        near += measured_m[c] < 0.005;
        bool left = false;
        for (int k = 0; k < 40; ++k) {
          // The scan is good to 1e-5 of the links.
          const Vector3d step = random.direction();
          EXPECT_TRUE(reaches(chains[c] + (measured_m[c] - 2e-6) * step, links[c][0], links[c][1]));
          left = left || !reaches(chains[c] + (1.2 * measured_m[c] + 1e-5) * step, links[c][0],
                                  links[c][1]);
        }
        tight += left;
      }
    }
    EXPECT_EQ(s.nearest_branch_m, least_m);
    const BranchDistance& nearest = s.branch[s.nearest_leg - 1];
    EXPECT_EQ(s.nearest_joint == 1 ? nearest.theta1_m : nearest.theta4_m, least_m);
  }
  EXPECT_GT(near, 20);
  EXPECT_GT(tight, 2000) << "the distance is too small";
}

TEST(Singularity, FunctionsOfTheHapticThreadDoNotAllocate) {
  TROCAR_NEEDS_COUNTED_ALLOCATIONS();
  const DeviceDescription device = default_device_description();
  const MotorModel motors = make_motor_model(device);
  Random random(44);
  const std::uint64_t before = allocations_in_scopes();
  double kept = 0;
  for (int n = 0; n < 200; ++n) {
    const Solved at = random_solved(random, device, kWide);
    Wrench wanted;
    wanted << 120 * random.in_ball(), 3 * random.in_ball();
    Jacobian flat = at.G;  // holds no motion along the last axis
    flat.col(5) = 1e-9 * flat.col(5) + flat.col(4);
    const NoAllocationScope scope;
    kept += singular_range(flat).smallest;
    kept += measure_singularity(device, at.T, at.joints, at.G).nearest_branch_m;
    const MotorVector bias = compensation_torques(device, motors, at.G, MotorVector::Ones(),
                                                  {.friction = true, .gravity = true});
    const MotorLoad load = advance(motors, {}, motor_currents(motors, bias), 1e-3);
    kept += allocate_torques_with_bias(at.G, wanted, available_torque(motors, load), bias).scale;
  }
  EXPECT_EQ(allocations_in_scopes(), before);
  EXPECT_TRUE(std::isfinite(kept));
}

}  // namespace
}  // namespace trocar::runtime
