// SPDX-License-Identifier: Apache-2.0
// Friction of the tip along a surface that it presses on without breaking it. Its energy is in
// cutting_energy_test.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "tests/runtime/haptics/bone/cutting_fixture.h"

namespace trocar::runtime {
namespace {

using Eigen::Vector3d;

// Bone that holds 60 N; the tip is the plate's origin unless a length is given.
Bench friction_bench(double coefficient, double length_m = 0) {
  Bench b(even_slabs(10, 1e-3, 60));
  b.options.tip_friction = coefficient;
  b.options.tool.tip_plate_m = {0, 0, -length_m};
  b.options.coupling.rotation_Nm_per_rad = 1e3;
  return b;
}
Vector3d friction_tip_of(const Bench& b) {
  return b.state.T_device_proxy * b.options.tool.tip_plate_m;
}

// Plate depth at which tip and coupling in series press with a force.
constexpr double depth_for(double force_N) {
  return force_N / 4000 + force_N / 20'000;
}

TEST(TipFriction, SlidesAtTheCoefficientTimesTheNormalForce) {
  for (const double mu : {0.1, 0.3, 0.6}) {
    for (const double normal : {10.0, 40.0}) {
      Bench b = friction_bench(mu);
      const double depth = depth_for(normal), shear = mu * normal / 1e-4;
      b.move(plate_at(0, -0.001), plate_at(0, depth), 1e-5);
      ASSERT_NEAR(b.out.tip_N, normal, 1e-6);
      // Held: coupling and contact in series.
      const double slides_at = mu * normal * (1 / 4000.0 + 1 / shear);
      b.move(plate_at(0, depth), plate_at(0.9 * slides_at, depth), 1e-5);
      EXPECT_NEAR(-b.out.wrench_device[0], 0.9 * mu * normal, 1e-4);
      EXPECT_NEAR(friction_tip_of(b).x(), 0.9e-4, 1e-7);
      // And back: elastic.
      b.move(plate_at(0.9 * slides_at, depth), plate_at(0, depth), 1e-5);
      EXPECT_NEAR(b.out.wrench_device[0], 0, 1e-4);
      EXPECT_NEAR(friction_tip_of(b).x(), 0, 1e-7);
      // Beyond: slides at the limit, and its elastic part stays when the hand comes back.
      b.move(plate_at(0, depth), plate_at(0.02, depth), 1e-5);
      EXPECT_NEAR(-b.out.wrench_device[0], mu * normal, 1e-4);
      EXPECT_NEAR(b.out.wrench_device[2], normal, 1e-4);
      EXPECT_NEAR(friction_tip_of(b).x(), 0.02 - mu * normal / 4000, 1e-6);
      b.move(plate_at(0.02, depth), plate_at(0.02 - 3 * slides_at, depth), 1e-5);
      EXPECT_NEAR(b.out.wrench_device[0], mu * normal, 1e-4);
      // Lifted: nothing is left.
      b.move(plate_at(0.02, depth), plate_at(0.02, -0.001), 1e-5);
      EXPECT_EQ(b.out.wrench_device.norm(), 0);
      EXPECT_EQ(b.state.tip_slip_m.norm(), 0);
    }
  }
}

TEST(TipFriction, NoneIsNone) {
  Bench b = friction_bench(0);
  b.move(plate_at(0, -0.001), plate_at(0, 0.006), 1e-5);
  b.move(plate_at(0, 0.006), plate_at(0.01, 0.006), 1e-5);
  EXPECT_NEAR(b.out.wrench_device[0], 0, 1e-6);
  EXPECT_EQ(b.state.tip_slip_m.norm(), 0);
}

// A tool that leans and is pushed straight down is held where it was put down as long as the tilt's
// tangent is less than the coefficient; without friction it slides down along itself.
TEST(TipFriction, HoldsAtASmallTilt) {
  for (const double mu : {0.0, 0.3}) {
    for (const double tilt : {0.05, 0.1, 0.2, 0.4}) {
      Bench b = friction_bench(mu, 0.1);
      Pose above = plate_at(0, 0, tilt);
      above.p_m = Vector3d(0, 0, 1e-4) - above.q * b.options.tool.tip_plate_m;
      Pose pressed = above;
      pressed.p_m.z() -= 0.006;
      b.move(above, pressed, 1e-5);
      const double normal = b.out.tip_N;
      ASSERT_GT(normal, 10);
      ASSERT_LT(normal, 55);
      const Vector3d axis = b.state.T_device_proxy.q * b.options.tool.inward_plate;
      const Vector3d tip = friction_tip_of(b), slid = tip - axis * axis.dot(tip);
      const double held_N =
          (b.out.wrench_device.head<3>() - axis * axis.dot(b.out.wrench_device.head<3>())).norm();
      if (mu == 0) {
        EXPECT_GT(slid.norm(), 0.9 * 0.006 * std::sin(tilt));
        EXPECT_LT(held_N, 1e-4);
      } else if (std::tan(tilt) < 0.9 * mu) {
        EXPECT_LT(b.state.tip_slip_m.norm(), 0.99 * 1e-4);
        // Coupling and contact in series, along and across; the contact's stiffness across is that
        // of the force that presses on it.
        const double along = 1 / (1 / 4000.0 + 1 / 20'000.0);
        double expected_N = 0;
        for (int k = 0; k < 1000; ++k) {
          const double N = normal * (k + 0.5) / 1000;
          const double across = 1 / (1 / 4000.0 + 0.1 * 0.1 / 1e3 + 1e-4 / (mu * N));
          expected_N += std::tan(tilt) * across / along * normal / 1000;
        }
        EXPECT_NEAR(held_N, expected_N, 0.01 * held_N);
        // Held for as long as it is pressed.
        for (int k = 0; k < 2000; ++k)
          b.tick(pressed);
        EXPECT_NEAR((friction_tip_of(b) - tip).norm(), 0, 1e-9);
      } else {
        EXPECT_NEAR(held_N, mu * normal, 0.02 * mu * normal);
      }
    }
  }
}

// Sliding under load: per tick no more than holding the wrench leaks, and the work of a round trip
// is what friction takes.
TEST(TipFriction, TakesItsWork) {
  Bench b = friction_bench(0.4);
  const double depth = depth_for(25), K = b.options.coupling.translation_N_per_m;
  b.move(plate_at(0, -0.001), plate_at(0, depth), 1e-5);
  double stored = b.out.stored_J, work = 0;
  const double start = stored;
  Pose before = plate_at(0, depth);
  Wrench w = b.out.wrench_device;
  double travelled = 0;
  for (int k = 1; k <= 4000; ++k) {
    const Pose X = plate_at(0.02 * std::sin(2 * 3.14159265358979 * k / 4000), depth);
    b.tick(X);
    const Twist dx = displacement(before, X);
    EXPECT_LE(b.out.stored_J - stored + w.dot(dx), 0.5 * K * dx.head<3>().squaredNorm() + 1e-12);
    work -= 0.5 * (w + b.out.wrench_device).dot(dx);
    travelled += dx.head<3>().norm();
    before = X;
    w = b.out.wrench_device;
    stored = b.out.stored_J;
  }
  // Less at each turn what the elastic part takes back.
  const double slides_at = 0.4 * 25 / 4000.0 + 1e-4;
  EXPECT_NEAR(work - (stored - start), 0.4 * 25 * (travelled - 5 * slides_at), 1e-4);
  EXPECT_GT(work, 0.5);
}

}  // namespace
}  // namespace trocar::runtime
