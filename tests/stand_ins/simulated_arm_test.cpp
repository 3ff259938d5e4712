// SPDX-License-Identifier: Apache-2.0
// The simulated arm of the stand-ins, against the exact solution. (The stand-in for Force Dimension's
// library: force_dimension_test.cpp.)
#include "tests/stand_ins/simulated_arm.h"

#include <gtest/gtest.h>

#include <cmath>

namespace stand_in {
namespace {

const Eigen::Vector3d kNone = Eigen::Vector3d::Zero();
constexpr ArmSettings kArm;

TEST(SimulatedArm, AnswersAForceAsADampedSpring) {
  SimulatedArm arm({});
  const Eigen::Vector3d force(0, 0, 4);
  const double natural = std::sqrt(kArm.hand_stiffness_N_per_m / kArm.mass_kg);
  const double decay = kArm.hand_damping_N_s_per_m / (2 * kArm.mass_kg);
  const double damped = std::sqrt(natural * natural - decay * decay);
  const double end_m = force.z() / kArm.hand_stiffness_N_per_m;
  for (int i = 0; i < 41; ++i) {
    const double t_s = 0.0123 * i;
    arm.advance(t_s, force, kNone);
    const double swing = std::cos(damped * t_s) + decay / damped * std::sin(damped * t_s);
    EXPECT_NEAR(arm.position_m().z(), end_m * (1 - std::exp(-decay * t_s) * swing), 0.005 * end_m)
        << t_s;
  }
  EXPECT_EQ(arm.position_m().x(), 0);
}

}  // namespace
}  // namespace stand_in
