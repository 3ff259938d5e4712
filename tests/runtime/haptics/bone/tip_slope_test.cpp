// SPDX-License-Identifier: Apache-2.0
// The tip on a sloping surface that it does not break. Its energy is in cutting_energy_test.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "tests/runtime/haptics/bone/cutting_fixture.h"

namespace trocar::runtime {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

// Bone that holds 200 N with a surface that falls towards +x.
Bench slope_bench(double slope, double friction, double length_m = 0) {
  Bench b(even_slabs(20, 1e-3, 200));
  b.options.slope = Vector2d(slope, 0);
  b.options.tip_friction = friction;
  b.options.tip_presliding_m = 1e-5;
  b.options.tool.tip_plate_m = {0, 0, -length_m};
  b.options.coupling.translation_N_per_m = 100'000;
  b.options.coupling.rotation_Nm_per_rad = 1e3;
  return b;
}
Vector3d slope_tip_of(const Bench& b) {
  return b.state.T_device_proxy * b.options.tool.tip_plate_m;
}

// Straight down, held sideways: the surface pushes along its normal, and its friction up the slope.
TEST(TipSlope, TheForceSidewaysIsThatOfTheFrictionCone) {
  for (const double slope : {0.5, 0.8, 1.0, 1.5}) {
    for (const double friction : {0.0, 0.1, 0.3}) {
      Bench b = slope_bench(slope, friction);
      // Slowly, because the limit of friction follows the force by a tick.
      b.move(plate_at(0, -0.001), plate_at(0, 0.002), 1e-6);
      const Wrench& w = b.out.wrench_device;
      ASSERT_GT(w[2], 10);
      EXPECT_EQ(b.cut_J, 0);
      EXPECT_NEAR(w[0] / w[2], (slope - friction) / (1 + friction * slope), 5e-4)
          << slope << ", " << friction;
      EXPECT_NEAR(w[1], 0, 1e-9);
    }
  }
}

// A plate that gives way sideways.
TEST(TipSlope, TheTipSlidesIfTheSlopeIsSteeperThanTheFriction) {
  for (const double slope : {0.1, 0.25, 0.35, 1.0}) {
    constexpr double kFriction = 0.3;
    Bench b = slope_bench(slope, kFriction);
    b.move(plate_at(0, -0.001), plate_at(0, 0.002), 1e-5);
    double lost_m = 0;
    for (int k = 0; k < 200; ++k) {
      const Vector3d before = slope_tip_of(b);
      b.tick(plate_at(before.x(), 0.002));
      lost_m = std::max(lost_m, slope_tip_of(b).x() - before.x());
    }
    const double slid_m = slope_tip_of(b).x();
    if (slope < kFriction) {
      EXPECT_LT(slid_m, 5e-5) << slope;
    } else {
      EXPECT_GT(slid_m, 5e-4) << slope;
      // The tip follows the surface: its stretch is what lies beyond the surface at its place.
      EXPECT_NEAR(b.state.stretch_m, -slope_tip_of(b).z() - slope * slid_m, 1e-9);
    }
    EXPECT_EQ(b.cut_J, 0);
    EXPECT_EQ(b.out.embedded_m, 0) << "no bone surrounds a tool on a surface";
  }
}

// The same slope and a tool that stands upright on it.
TEST(TipSlope, AToolAlongTheNormalIsNotPushedAside) {
  for (const double slope : {0.3, 0.6}) {
    for (const double friction : {0.0, 0.3}) {
      Bench b = slope_bench(slope, friction, 0.1);
      Pose above = plate_at(0, 0, std::atan(slope));
      const Vector3d along = above.q * Vector3d::UnitZ();
      above.p_m = 1e-3 * along - above.q * b.options.tool.tip_plate_m;
      Pose pressed = above;
      pressed.p_m -= 3e-3 * along;
      b.move(above, pressed, 1e-5);
      const Vector3d force = b.out.wrench_device.head<3>();
      ASSERT_GT(force.norm(), 10);
      EXPECT_NEAR((force - along * along.dot(force)).norm(), 0, 1e-6 * force.norm());
    }
  }
}

TEST(TipSlope, IsNeverSteeperThanItsLimit) {
  for (const double slope : {2.0, 10.0, 1e6}) {
    Bench b = slope_bench(slope, 0);
    b.move(plate_at(0, -0.001), plate_at(0, 0.002), 1e-5);
    EXPECT_NEAR(b.out.wrench_device[0] / b.out.wrench_device[2], kMaxSlope, 1e-6);
  }
}

// In a hole the walls hold the shaft: a slope that is known no more pushes no more.
TEST(TipSlope, InsideBoneTheForceActsAlongTheShaft) {
  Bench b = slope_bench(1, 0);
  b.move(plate_at(0, -0.001), plate_at(0, 0.002), 1e-5);
  b.options.slope.reset();
  for (int k = 0; k < 50; ++k)
    b.tick(plate_at(0, 0.002));
  EXPECT_NEAR(b.out.wrench_device[0], 0, 1e-6);
  EXPECT_GT(b.out.wrench_device[2], 10);
}

}  // namespace
}  // namespace trocar::runtime
