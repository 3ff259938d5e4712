// SPDX-License-Identifier: Apache-2.0
// The tip on and in bone: friction, hold, slope, twist and bevel. Its energy is in cutting_energy_test.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "tests/runtime/haptics/bone/cutting_fixture.h"

namespace trocar::runtime {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

// Friction of the tip along a surface that it presses on without breaking it. Its energy is in
// cutting_energy_test.

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
      b.push(-0.001, depth, 1e-5);
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
        EXPECT_EQ(b.state.tip_slip_m.norm(), 0);
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

// Crushed bone holds the tip when it is pulled back. The hold's energy is in cutting_energy_test.

constexpr double kRadius_m = 1.5e-3, kPresliding_m = 1e-4;

Bench hold_bench(double tip_hold, std::vector<CuttingSlab> slabs) {
  Bench b(std::move(slabs));
  b.options.tip_hold = tip_hold;
  b.options.tip_presliding_m = kPresliding_m;
  b.options.tool.radius_m = kRadius_m;
  b.options.tip_N_per_m = 1e6;
  b.options.coupling.translation_N_per_m = 1e5;
  return b;
}

/// The force on the plate along z.
double pull_N(const Bench& b) {
  return b.out.wrench_device[2];
}

TEST(TipHold, ResistsWithdrawalWithItsFractionOfTheCrushingForce) {
  for (const double hold : {0.0, 0.1, 0.25, 0.8}) {
    Bench b = hold_bench(hold, even_slabs(10, 1e-3, 60));
    b.push(-0.001, 0.005, 1e-6);
    ASSERT_NEAR(pull_N(b), 60, 1e-6) << "the hold does not resist advance";
    const double cut_J = b.cut_J, deepest_m = -b.state.T_device_proxy.p_m.z();
    double least_N = 60;
    b.push(0.005, 0.002, 1e-6, [&](const CuttingResult& out, const Pose&) {
      least_N = std::min(least_N, out.wrench_device[2]);
      const double raised_m = deepest_m + b.state.T_device_proxy.p_m.z();
      if (raised_m < 2 * kPresliding_m) return;
      // Fades while the tip is raised by a diameter.
      const double limit_N = hold * 60 * std::max(0.0, 1 - raised_m / (2 * kRadius_m));
      EXPECT_NEAR(out.wrench_device[2], -limit_N, 0.02 * hold * 60 + 1e-9) << raised_m;
    });
    EXPECT_NEAR(least_N, -hold * 60, 0.06 * hold * 60 + 1e-9);
    EXPECT_EQ(b.cut_J, cut_J);
  }
}

// Behind a hard layer the force that is remembered falls to that of the soft bone, exponentially
// over a diameter of the tool.
TEST(TipHold, AHardLayerIsForgottenBehindIt) {
  std::vector<CuttingSlab> slabs = even_slabs(20, 1e-3, 10);
  slabs[0].strength_top_N = slabs[0].strength_bottom_N = 100;
  Bench b = hold_bench(0.5, slabs);
  b.push(-0.001, 0.018, 1e-6, [&](const CuttingResult& out, const Pose&) {
    if (out.front_m < 2e-3) return;
    EXPECT_NEAR(b.state.hold_tip_N, 10 + 90 * std::exp(-(out.front_m - 1e-3) / (2 * kRadius_m)),
                0.9);
  });
  EXPECT_NEAR(b.state.hold_tip_N, 10, 0.5);
}

// Behind the last bone no crushed bone is around the tip, whether there is more bone far below or
// not.
TEST(TipHold, ATipThatHasBrokenThroughIsNotHeld) {
  std::vector<CuttingSlab> slabs = even_slabs(10, 1e-3, 60);
  Bench last = hold_bench(0.25, slabs);
  slabs.push_back(slabs.back());
  slabs.back().top_m = 60e-3;
  slabs.back().bottom_m = 61e-3;
  Bench more = hold_bench(0.25, slabs);
  double most_N = 0, least_N = 0;
  for (int k = 0; k <= 1400; ++k) {
    // The plate goes to a depth of 11 mm, and back to 9 mm.
    const double depth_m = k <= 1200 ? -1e-3 + 1e-5 * k : 11e-3 - 1e-5 * (k - 1200);
    last.tick(plate_at(0, depth_m));
    more.tick(plate_at(0, depth_m));
    ASSERT_NEAR(pull_N(last), pull_N(more), 1e-5) << depth_m;
    most_N = std::max(most_N, pull_N(last));
    least_N = std::min(least_N, pull_N(last));
  }
  EXPECT_NEAR(most_N, 60, 1e-3);
  EXPECT_GE(least_N, -1e-5);
}

// The tip on a sloping surface that it does not break. Its energy is in cutting_energy_test.

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
      b.push(-0.001, 0.002, 1e-6);
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
    b.push(-0.001, 0.002, 1e-5);
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
    b.push(-0.001, 0.002, 1e-5);
    EXPECT_NEAR(b.out.wrench_device[0] / b.out.wrench_device[2], kMaxSlope, 1e-6);
  }
}

// In a hole the walls hold the shaft: a slope that is known no more pushes no more.
TEST(TipSlope, InsideBoneTheForceActsAlongTheShaft) {
  Bench b = slope_bench(1, 0);
  b.push(-0.001, 0.002, 1e-5);
  b.options.slope.reset();
  for (int k = 0; k < 50; ++k)
    b.tick(plate_at(0, 0.002));
  EXPECT_NEAR(b.out.wrench_device[0], 0, 1e-6);
  EXPECT_GT(b.out.wrench_device[2], 10);
}

// The moment that turns a tip in what it cuts. Its energy is in cutting_energy_test.

constexpr double kTurnRadius_m = 1.5e-3, kTurnPresliding_m = 1e-5, kTwist_Nm = 0.02;

Bench turned_bench(double torsion_Nm) {
  Bench b(even_slabs(10, 1e-3, 60));
  b.options.torsion_Nm = torsion_Nm;
  b.options.tip_presliding_m = kTurnPresliding_m;
  b.options.tool.radius_m = kTurnRadius_m;
  b.options.coupling.rotation_Nm_per_rad = 20;
  return b;
}

Pose turned_to(double angle, double depth_m) {
  Pose T;
  T.p_m = {0, 0, -depth_m};
  T.q = from_rotation_vector({0, 0, angle});
  return T;
}

TEST(TipTwist, TurningNeedsItsMomentAndTakesItsWork) {
  for (const double sense : {1.0, -1.0}) {
    Bench b = turned_bench(kTwist_Nm);
    b.push(-0.001, 0.02, 1e-5);
    ASSERT_GT(b.out.tip_N, 50);
    EXPECT_EQ(b.out.wrench_device[5], 0) << "nothing turns";
    double work_J = 0, before = 0;
    const double stored_J = b.out.stored_J;
    for (int k = 1; k <= 2000; ++k) {
      b.tick(turned_to(sense * 1e-3 * k, 0.02));
      const double moment_Nm = -sense * b.out.wrench_device[5];
      EXPECT_LE(moment_Nm, kTwist_Nm * (1 + 1e-9));
      work_J += 0.5 * (before + moment_Nm) * 1e-3;
      before = moment_Nm;
    }
    EXPECT_NEAR(before, kTwist_Nm, 1e-6);
    // The elastic parts turn by 1 mrad in the coupling and 7 mrad at the tip.
    EXPECT_NEAR(work_J - (b.out.stored_J - stored_J), kTwist_Nm * (2 - 1e-3 - 1e-5 / 1.5e-3), 1e-4);
  }
}

TEST(TipTwist, ATipWithoutLoadTurnsFreely) {
  Bench b = turned_bench(kTwist_Nm);
  b.push(-0.01, -0.002, 1e-5);
  b.tick(turned_to(0.5, -0.002));
  EXPECT_EQ(b.out.wrench_device.norm(), 0);
  Bench none = turned_bench(0);
  none.push(-0.001, 0.02, 1e-5);
  none.tick(turned_to(0.5, 0.02));
  EXPECT_NEAR(none.out.wrench_device[5], 0, 1e-9);
}

// A bevelled tip is pushed to one side inside bone. Its energy is in cutting_energy_test.

constexpr double kBevelStrength_N = 60;

// A bevel whose face looks along +x, in bone of thin slabs.
Bench bevelled_bench(double ratio, double wall_N_per_m2 = 0, double wall_strength_N_per_m = 0) {
  Bench b(even_slabs(200, 1e-4, kBevelStrength_N));
  b.hold_shaft(0, wall_N_per_m2, wall_strength_N_per_m);
  b.options.tool.bevel_plate = {ratio, 0, 0};
  b.options.tool.tip_plate_m = {0, 0, -0.1};
  b.options.coupling.translation_N_per_m = 100'000;
  b.options.coupling.rotation_Nm_per_rad = 1e3;
  return b;
}
Pose bevelled_tip_at(double x_m, double depth_m, double turn_rad = 0) {
  Pose T;
  T.q = from_rotation_vector({0, 0, turn_rad});
  T.p_m = {x_m, 0, 0.1 - depth_m};
  return T;
}
Vector3d bevelled_tip(const Bench& b) {
  return b.state.T_device_proxy * b.options.tool.tip_plate_m;
}

TEST(TipBevel, WithoutWallsThePlateFeelsTheWholeForceToTheSide) {
  for (const double ratio : {0.3, 0.8, 1.7}) {
    for (const double turn_rad : {0.0, 1.0}) {
      Bench b = bevelled_bench(ratio);
      b.options.tool.tip_plate_m.setZero();  // no lever, so the plate does not tilt
      Pose above = bevelled_tip_at(0, 0, turn_rad);
      above.p_m.z() = 1e-3;
      Pose inside = above;
      inside.p_m.z() = -8e-3;
      b.move(above, inside, 1e-5);
      const Wrench& w = b.out.wrench_device;
      ASSERT_NEAR(w[2], kBevelStrength_N, 0.1);
      EXPECT_NEAR(w[0] / w[2], -ratio * std::cos(turn_rad), 1e-4);
      EXPECT_NEAR(w[1] / w[2], -ratio * std::sin(turn_rad), 1e-4);
    }
  }
}

TEST(TipBevel, TheTipDriftsAwayFromTheFaceAndFartherWithEachMillimetre) {
  const auto drift_m = [](double ratio, double turn_rad, double depth_m) {
    Bench b = bevelled_bench(ratio, 2e8, 2e4);
    b.options.coupling.translation_N_per_m = 10'000;
    b.options.coupling.rotation_Nm_per_rad = 20;
    b.move(bevelled_tip_at(0, -1e-3, turn_rad), bevelled_tip_at(0, depth_m, turn_rad), 1e-5);
    return bevelled_tip(b);
  };
  EXPECT_NEAR(drift_m(0, 0, 15e-3).head<2>().norm(), 0, 1e-9);
  double before_m = 0;
  for (const double depth_m : {5e-3, 10e-3, 15e-3}) {
    const double x_m = drift_m(0.8, 0, depth_m).x();
    EXPECT_LT(x_m, before_m - 2e-5) << depth_m;
    EXPECT_NEAR(drift_m(0.8, std::acos(-1.0), depth_m).x(), -x_m, 1e-6) << "turned by half a turn";
    before_m = x_m;
  }
  EXPECT_LT(drift_m(1.2, 0, 15e-3).x(), before_m - 2e-5) << "a larger force drifts farther";
}

// While the tip drifts, the front moves with it between the ticks and passes slabs there.
TEST(TipBevel, ReportsEachSlabOnceHoweverFastTheTipDrifts) {
  for (const double step_m : {1e-6, 1e-5, 2e-4}) {
    Bench b = bevelled_bench(1.7, 1e6, 100);
    b.options.coupling.translation_N_per_m = 3'000;
    int next = 0;
    b.move(bevelled_tip_at(0, -1e-3), bevelled_tip_at(0, 15e-3), step_m,
           [&](const CuttingResult& out, const Pose&) {
             if (out.passed_from == out.passed_to) return;
             EXPECT_EQ(out.passed_from, next);
             next = out.passed_to;
           });
    EXPECT_GT(-bevelled_tip(b).x(), 1e-3);
    EXPECT_GT(next, 50);
    EXPECT_NEAR(next * 1e-4, b.out.front_m, 1e-4 + 1e-9);
  }
}

// Contract 7: work of cutting and of the walls together are the work of the hand.
TEST(TipBevel, TheSpringsEnergyDoesTheWorkOnTheWall) {
  for (const double ratio : {0.0, 0.8}) {
    Bench b = bevelled_bench(ratio, 2e7, 1e4);
    const Pose start = bevelled_tip_at(0, -1e-3);
    Pose before = start;
    b.tick(start);
    Wrench held = b.out.wrench_device;
    double hand_J = 0;
    b.move(start, bevelled_tip_at(0, 15e-3), 1e-6, [&](const CuttingResult& out, const Pose& X) {
      const Wrench mean = 0.5 * (held + out.wrench_device);
      hand_J -= mean.dot(displacement(before, X));
      held = out.wrench_device;
      before = X;
    });
    const double lost_J = hand_J - b.cut_J - b.out.stored_J;
    if (ratio > 0)
      EXPECT_GT(lost_J, 1e-4) << "walls have yielded";
    else
      EXPECT_NEAR(lost_J, 0, 1e-6);
    // The tip's path along the force, 1 along the shaft and -ratio to the side, times the strength. The shaft tilts
    // by some degrees.
    const Vector3d tip = bevelled_tip(b);
    EXPECT_NEAR(b.cut_J, kBevelStrength_N * (-tip.z() + ratio * tip.x() - b.state.stretch_m),
                5e-3 * b.cut_J);
  }
}

TEST(TipBevel, HasNoEffectOnASurface) {
  for (const double ratio : {0.0, 0.8}) {
    Bench b = bevelled_bench(ratio);
    b.options.slope = Eigen::Vector2d(0.2, 0);
    b.move(bevelled_tip_at(0, -1e-3), bevelled_tip_at(0, 5e-4), 1e-6);
    ASSERT_EQ(b.cut_J, 0);
    EXPECT_NEAR(b.out.wrench_device[0] / b.out.wrench_device[2], 0.2, 1e-6);
  }
}

}  // namespace
}  // namespace trocar::runtime
