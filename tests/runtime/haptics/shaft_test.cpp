// SPDX-License-Identifier: Apache-2.0
// The contract of runtime/haptics/tool.h.
#include "runtime/haptics/tool.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace trocar::runtime {
namespace {

constexpr double kTick_s = 1e-3;

ShaftSection down_to(double inserted_m, double x_m = 0, double y_m = 0) {
  ShaftSection place;
  place.at_m = {x_m, y_m, 0.12};
  place.inserted_m = inserted_m;
  return place;
}

ShaftTissue sticky() {
  ShaftTissue tissue;
  tissue.dry_friction_N = 2;
  return tissue;
}

TEST(Shaft, NoForceWithoutAHoleOrWithDefaultTissue) {
  ShaftState state;
  EXPECT_EQ(shaft_force(sticky(), down_to(0.01, 0.01), kTick_s, state), Eigen::Vector3d::Zero());
  EXPECT_EQ(shaft_force(sticky(), down_to(0.02, 0.01), kTick_s, state), Eigen::Vector3d::Zero());
  enter_hole(down_to(0.02), state);
  EXPECT_EQ(shaft_force({}, down_to(0.03, 0.01), kTick_s, state), Eigen::Vector3d::Zero());
}

TEST(Shaft, DryFrictionRisesToItsValueAndReversesWithTheMotion) {
  const ShaftTissue tissue = sticky();
  ShaftState state;
  enter_hole(down_to(0.01), state);
  EXPECT_NEAR(shaft_force(tissue, down_to(0.01 + tissue.presliding_m / 2), kTick_s, state).z(), 1,
              1e-12);
  EXPECT_NEAR(shaft_force(tissue, down_to(0.02), kTick_s, state).z(), 2, 1e-12);
  EXPECT_NEAR(shaft_force(tissue, down_to(0.02), kTick_s, state).z(), 2, 1e-12) << "at rest";
  EXPECT_NEAR(shaft_force(tissue, down_to(0.02 - tissue.presliding_m), kTick_s, state).z(), 0,
              1e-12);
  EXPECT_NEAR(shaft_force(tissue, down_to(0.015), kTick_s, state).z(), -2, 1e-12);
}

TEST(Shaft, ViscousFrictionIsTheSpeedTimesTheCoefficientAlongATiltedAxis) {
  ShaftTissue tissue;
  tissue.viscous_friction_N_s_per_m = 10;
  ShaftState state;
  ShaftSection place = down_to(0.01);
  place.axis = Eigen::Vector3d(0.6, 0, 0.8);
  enter_hole(place, state);
  place.inserted_m += 1e-4;  // 0.1 m/s
  EXPECT_LT((shaft_force(tissue, place, kTick_s, state) - Eigen::Vector3d(0.6, 0, 0.8)).norm(),
            1e-12);
}

TEST(Shaft, FrictionIsBoundedAndDissipatesOverAClosedMotion) {
  const ShaftTissue tissue = sticky();
  std::mt19937_64 random(1);
  for (int trial = 0; trial < 200; ++trial) {
    ShaftState state;
    enter_hole(down_to(0.02), state);
    double inserted_m = 0.02, taken_J = 0;
    const auto go = [&](double to_m) {
      const double before_N = tissue.dry_friction_N * state.spring_m / tissue.presliding_m;
      const double force_N = shaft_force(tissue, down_to(to_m), kTick_s, state).z();
      ASSERT_LE(std::abs(force_N), tissue.dry_friction_N * (1 + 1e-12));
      taken_J += (before_N + force_N) / 2 * (to_m - inserted_m);
      inserted_m = to_m;
    };
    // Steps below the spring's length, so that the trapezoidal sum is the work.
    for (int i = 0; i < 500; ++i) {
      const double u = static_cast<double>(random() >> 11) * 0x1p-53;
      go(inserted_m + (u - 0.5) * tissue.presliding_m);
    }
    while (std::abs(inserted_m - 0.02) > 1e-5)
      go(inserted_m + (inserted_m < 0.02 ? 1e-5 : -1e-5));
    go(0.02);
    ASSERT_GE(taken_J, -1e-9);
  }
}

TEST(Shaft, TheRimForceOpposesTheDisplacementInThePlane) {
  ShaftTissue tissue;
  tissue.rim_stiffness_N_per_m = 3000;
  ShaftState state;
  enter_hole(down_to(0.01, 0.005, -0.002), state);
  EXPECT_LT((shaft_force(tissue, down_to(0.02, 0.006, -0.004), kTick_s, state) -
             Eigen::Vector3d(-3, 6, 0))
                .norm(),
            1e-12);
}

TEST(Shaft, EnteringAHoleAgainTakesAndGivesNoEnergy) {
  ShaftTissue tissue = sticky();
  tissue.viscous_friction_N_s_per_m = 10;
  tissue.rim_stiffness_N_per_m = 3000;
  ShaftState state;
  enter_hole(down_to(0.01), state);
  EXPECT_GT(shaft_force(tissue, down_to(0.02, 0.004), kTick_s, state).norm(), 10);
  state.in_hole = false;  // drawn out
  const ShaftSection back = down_to(1e-4, 2e-4, -1e-4);
  EXPECT_EQ(shaft_force(tissue, back, kTick_s, state), Eigen::Vector3d::Zero());
  enter_hole(back, state);
  EXPECT_EQ(shaft_force(tissue, back, kTick_s, state), Eigen::Vector3d::Zero());
  // Friction and rim then act as after a puncture at this position.
  const Eigen::Vector3d force_N = shaft_force(tissue, down_to(1e-2, 2e-4, 0), kTick_s, state);
  EXPECT_LT((force_N - Eigen::Vector3d(0, -0.3, 2 + 10 * 9.9)).norm(), 1e-9);
}

}  // namespace
}  // namespace trocar::runtime
