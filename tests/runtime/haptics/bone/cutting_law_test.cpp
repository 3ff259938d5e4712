// SPDX-License-Identifier: Apache-2.0
// The cutting law: closed forms, its ticks, holes that outlive withdrawal, and soft layers. Its energy is
// in cutting_energy_test.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

#include "runtime/haptics/bone/bone_volume.h"
#include "runtime/realtime/realtime_thread.h"
#include "tests/runtime/haptics/bone/cutting_fixture.h"
#include "tests/support/counted_allocations.h"

namespace trocar::runtime {
namespace {

using Eigen::Vector3d;

CuttingState state_for(const std::vector<CuttingSlab>& slabs) {
  return make_cutting_state(slabs.size(), 4);
}

// The paper's experiment: a sheet of 35 N and 5 kN/m, pushed by a rigid tool.
TEST(CuttingLaw, ThePapersSheet) {
  CuttingOptions options;
  options.coupling.is_rigid = true;
  options.tip_N_per_m = 5000;
  for (const double rate_Hz : {500.0, 1000.0, 8000.0}) {
    for (const double speed : {0.015, 0.2, 1.0}) {
      auto slabs = even_slabs(1, 0, 35);
      CuttingState state = state_for(slabs);
      CuttingResult out;
      double peak = 0, at_peak = 0;
      for (int k = 0; speed * k / rate_Hz < 0.03; ++k) {
        const double depth = speed * k / rate_Hz - 0.002;
        cutting_tick(options, plate_at(0, depth), slabs, state, out);
        const double force = out.wrench_device[2];
        if (depth <= 0 || depth > 0.007 + 1e-12) {
          EXPECT_EQ(force, 0) << depth;
        } else if (depth <= 0.007 - 1e-12) {
          EXPECT_NEAR(force, 5000 * depth, 1e-9);
        }
        if (force > peak) peak = force, at_peak = depth;
        EXPECT_EQ(out.cut_J, 0);  // no thickness, no work beyond the elastic
      }
      EXPECT_LE(peak, 35);
      EXPECT_GE(peak, 35 - 5000 * speed / rate_Hz - 1e-9);
      EXPECT_NEAR(at_peak, 0.007, speed / rate_Hz + 1e-12);
    }
  }
}

// A tool that is tilted while it presses on a sheet stays on it. The distance along the shaft from the sheet to the tip
// grows with the tilt, and the front must not pass the sheet by that.
TEST(CuttingLaw, ATiltedToolStaysOnItsSheet) {
  for (const bool is_rigid : {true, false}) {
    Bench b(even_slabs(1, 0, 35));
    b.options.coupling.is_rigid = is_rigid;
    b.options.coupling.translation_N_per_m = 50'000;
    b.options.coupling.rotation_Nm_per_rad = 50;
    b.options.tip_N_per_m = 5000;
    b.push(-0.001, 0.003, 1e-5);
    const double upright_N = b.out.tip_N;
    ASSERT_GT(upright_N, 12);
    for (const double aim : {0.2, -0.2, 0.0}) {
      const double from = aim == 0.2 ? 0 : aim == -0.2 ? 0.2 : -0.2;
      for (int k = 1; k <= 500; ++k) {
        b.tick(plate_at(0, 0.003, from + (aim - from) * k / 500));
        ASSERT_NEAR(b.out.tip_N, upright_N, 0.04 * upright_N) << "tilt " << aim << ", " << k;
        ASSERT_EQ(b.out.front_m, 0);
        ASSERT_EQ(b.out.passed_from, b.out.passed_to);
      }
    }
    EXPECT_NEAR(b.out.tip_N, upright_N, 1e-3 * upright_N) << "upright again";
    EXPECT_NEAR(b.peak_N(plate_at(0, 0.003), plate_at(0, 0.012), 1e-5), 35, 0.06);
    EXPECT_EQ(b.out.tip_N, 0) << "broken";
  }
}

// The front's work does not depend on speed or rate; what remains is the friction of the whole length.
TEST(CuttingLaw, WorkIsThatOfTheStrength) {
  CuttingOptions options;
  options.coupling.translation_N_per_m = 4000;
  for (const double friction_N_per_m : {0.0, 100.0}) {
    auto slabs = even_slabs(35, 1e-3, 0);
    double expected = 0;
    for (std::size_t i = 0; i < slabs.size(); ++i) {
      CuttingSlab& slab = slabs[i];
      slab.strength_top_N = i == 0 ? 60 : slabs[i - 1].strength_bottom_N;
      slab.strength_bottom_N = i < 3 ? 60 - 15.0 * static_cast<double>(i + 1)
                                     : 15 + 5 * std::sin(0.4 * static_cast<double>(i));
      slab.friction_N_per_m = friction_N_per_m;
      expected += 0.5 * (slab.strength_top_N + slab.strength_bottom_N) * 1e-3;
    }
    for (const double rate_Hz : {500.0, 1000.0, 2000.0, 4000.0, 8000.0}) {
      for (const double speed : {0.02, 0.2, 1.0}) {
        CuttingState state = state_for(slabs);
        CuttingResult out;
        double work = 0;
        for (int k = 0; speed * k / rate_Hz < 0.08; ++k) {
          cutting_tick(options, plate_at(0, speed * k / rate_Hz - 0.002), slabs, state, out);
          work += out.cut_J;
          ASSERT_TRUE(out.has_converged || friction_N_per_m > 0);
        }
        EXPECT_NEAR(work, expected, (friction_N_per_m > 0 ? 1e-3 : 1e-9) * expected)
            << rate_Hz << " " << speed;
        EXPECT_NEAR(out.wrench_device[2], friction_N_per_m * 0.035,
                    friction_N_per_m > 0 ? 0.01 * 3.5 : 1e-6);
      }
    }
  }
}

// The front's work in a slab with walls is that of each part, and the tip's force that of the part it is in.
TEST(CuttingLaw, WallsInASlabHaveTheirOwnStrength) {
  for (const double share : {1.0, 0.5}) {
    auto slabs = even_slabs(2, 2e-3, 10);
    slabs[0].cortex_N = slabs[1].cortex_N = 50;
    slabs[0].upper_wall_to_m = 1.2e-3;
    slabs[1].lower_wall_from_m = 3.5e-3;
    slabs[0].share = share;
    slabs[0].share_to_m = 0.7e-3;
    Bench b(slabs);
    b.options.coupling.is_rigid = true;
    b.options.tip_N_per_m = 1e6;
    double upper_N = 0, inside_N = 0, lower_N = 0;
    b.push(-0.001, 0.006, 1e-6, [&](const CuttingResult& out, const Pose&) {
      if (out.front_m > 0.8e-3 && out.front_m < 1.19e-3) upper_N = std::max(upper_N, out.tip_N);
      if (out.front_m > 1.3e-3 && out.front_m < 3.49e-3) inside_N = std::max(inside_N, out.tip_N);
      if (out.front_m > 3.51e-3) lower_N = std::max(lower_N, out.tip_N);
    });
    EXPECT_NEAR(upper_N, 50, 1e-9) << share;
    EXPECT_NEAR(inside_N, 10, 1e-9) << share;
    EXPECT_NEAR(lower_N, 50, 1e-9) << share;
    EXPECT_NEAR(b.cut_J, 50e-3 * (0.7 * share + 0.5 + 0.5) + 10e-3 * 2.3, 1e-12) << share;
  }
}

// A rigid rod on a Winkler foundation, pushed sideways (closed form; the walls have no strength limit).
TEST(CuttingLaw, RodInElasticBed) {
  for (const double thickness : {5e-4, 1e-3, 2e-3}) {
    CuttingOptions options;
    options.tool.tip_plate_m = {0, 0, -0.1};
    options.coupling.translation_N_per_m = 1e5;
    options.coupling.rotation_Nm_per_rad = 1e-3;  // a hand that holds a point
    options.tip_N_per_m = 1e5;
    options.max_steps = 60;
    options.tolerance = 1e-9;
    const double kappa = 2e8, embedded = 0.01;
    auto slabs = even_slabs(static_cast<int>(std::lround(0.01 / thickness)), thickness, 1e-3);
    for (CuttingSlab& slab : slabs) {
      slab.wall_N_per_m2 = kappa;
      slab.wall_strength_N_per_m = 1e9;
    }
    CuttingState state = state_for(slabs);
    CuttingResult out;
    for (int k = 0; k <= 120; ++k)
      cutting_tick(options, plate_at(0, -0.1 - 0.001 + 1e-4 * k), slabs, state, out);
    EXPECT_NEAR(out.embedded_m, embedded, 1e-9);
    for (int k = 1; k <= 50; ++k)
      cutting_tick(options, plate_at(4e-5 * k, -0.1 + 0.011), slabs, state, out);
    const double P = -out.wrench_device[0];
    ASSERT_GT(P, 0.5);
    const Vector3d tip = state.T_device_proxy * options.tool.tip_plate_m;
    const Vector3d axis = state.T_device_proxy.q * options.tool.inward_plate;
    const auto u = [&](double depth) { return (tip + axis * ((-depth - tip.z()) / axis.z())).x(); };
    const double a = 0.1 - 0.011, l = embedded;  // lever above the surface
    EXPECT_NEAR(u(0), P / (kappa * l) * (4 + 6 * a / l), 0.02 * u(0)) << thickness;
    EXPECT_NEAR(u(l), -P / (kappa * l) * (2 + 6 * a / l), 0.02 * std::abs(u(l))) << thickness;
  }
}

// The wrench of a rigid tool is the derivative of the energy stored: tip, friction along and
// around, and walls, with their levers.
TEST(CuttingLaw, TheWrenchIsTheEnergysDerivative) {
  for (const double clearance : {0.0, 2e-5}) {
    Bench b(even_slabs(20, 1e-3, 30));
    b.options.coupling.is_rigid = true;
    b.options.tool.tip_plate_m = {0.01, -0.02, -0.1};
    b.options.tool.inward_plate = Vector3d(0.1, 0.05, -1).normalized();
    b.options.tool.radius_m = 3e-3;
    b.hold_shaft(300, 1e7, 3e4, clearance);
    Pose X = plate_at(0, -0.105, 0.03);
    Pose deep = X;
    deep.p_m += X.q * b.options.tool.inward_plate * 0.018;
    b.move(X, deep, 1e-4);
    // Back a little, sideways and around: all elements are elastic.
    deep.p_m += Vector3d(2e-4, -1e-4, 5e-5);
    deep.q = from_rotation_vector({1e-3, 2e-3, 5e-3}) * deep.q;
    b.tick(deep);
    b.tick(deep);
    const Wrench w = b.out.wrench_device;
    EXPECT_GT(b.out.tip_N, 5);
    const CuttingState state = b.state;
    for (int i = 0; i < 6; ++i) {
      const double h = i < 3 ? 1e-8 : 1e-7;
      std::array<double, 2> E{};
      for (int side = 0; side < 2; ++side) {
        Twist d = Twist::Zero();
        d[i] = side == 0 ? -h : h;
        b.state = state;
        E[static_cast<std::size_t>(side)] =
            b.tick({deep.p_m + d.head<3>(), from_rotation_vector(d.tail<3>()) * deep.q}).stored_J;
      }
      EXPECT_NEAR(-w[i], (E[1] - E[0]) / (2 * h), 2e-4 * std::max(1.0, std::abs(w[i]))) << i;
      EXPECT_GT(std::abs(w[i]), 1e-3) << i;
    }
  }
}

// The friction of a core against the integral of its pressure, which grows from the tip upwards.
TEST(CuttingLaw, ACoresFrictionGrowsWithItsLength) {
  constexpr double kFraction = 0.4, kGrowth_per_m = 60, kFriction_N_per_m = 1000;
  Bench b(even_slabs(40, 1e-3, 20));
  b.hold_shaft(kFriction_N_per_m, 0, 0);
  b.options.core_fraction = kFraction;
  b.options.core_growth_per_m = kGrowth_per_m;
  b.options.presliding_m = 1e-5;
  b.options.coupling.translation_N_per_m = 1e5;
  for (const double depth_m : {0.01, 0.02, 0.03}) {
    b.push(depth_m - 0.0101, depth_m, 1e-5);
    const double length_m = b.out.embedded_m;
    double core_N = 0;
    for (int k = 0; k < 1000; ++k)
      core_N += kFriction_N_per_m * kFraction * length_m / 1000 *
                std::exp(kGrowth_per_m * length_m * (k + 0.5) / 1000);
    const double outer_N = kFriction_N_per_m * (1 - kFraction) * length_m;
    EXPECT_NEAR(b.out.wrench_device[2] - b.out.tip_N, core_N + outer_N, 0.01 * (core_N + outer_N))
        << depth_m;
  }
  EXPECT_EQ(core_friction_factor(b.options, 0), 1);
  EXPECT_LT(core_friction_factor(b.options, 10), 6) << "limited";
}

// What the haptic thread needs of the cutting law: no allocation, the same bits for the same input,
// a bound on what a tick computes.

Bench body_of_64() {
  Bench b(even_slabs(64, 5e-4, 15), 3);
  b.hold_shaft(100, 1e7, 1e4);
  b.options.tool.tip_plate_m = {0, 0, -0.1};
  b.options.coupling.max_force_N = 60;
  return b;
}

// The scene has two soft layers over the bone, and friction of the tip.
Bench soft_body_of_64() {
  static const std::array<SoftLayer, 2> layers{soft_layer(-0.002, 0.002, 500, 2e5, 5, 1, 100),
                                               soft_layer(0.004, 0.0045, 150, 1e4, 0.6, 0.1)};
  Bench b = body_of_64();
  b.options.tip_friction = 0.3;
  b.options.layers = layers;
  b.state = make_cutting_state(b.slabs.size(), 3, layers.size());
  return b;
}

// Down, sideways, out and in again at three places.
Pose pose_at(int k) {
  const double t = 1e-3 * k, depth = 0.04 * std::abs(std::sin(3 * t)) - 0.003;
  Pose X = plate_at(0.005 * std::floor(t / 1.1) + 0.002 * std::sin(9 * t), depth - 0.1,
                    0.05 * std::sin(2 * t));
  X.q = from_rotation_vector({0, 0, 0.3 * std::sin(7 * t)}) * X.q;
  return X;
}

TEST(CuttingTick, AllocatesNothing) {
  TROCAR_NEEDS_COUNTED_ALLOCATIONS();
  for (Bench b : {body_of_64(), soft_body_of_64()}) {
    const std::uint64_t before = allocations_in_scopes();
    int entered = 0, punctured = 0;
    {
      const NoAllocationScope scope;
      for (int k = 0; k < 4000; ++k) {
        const int hole = b.state.hole;
        b.tick(pose_at(k));
        entered += hole < 0 && b.state.hole >= 0;
        punctured += b.out.layer_cut_J > 0;
      }
    }
    EXPECT_EQ(allocations_in_scopes(), before);
    EXPECT_GE(entered, 4);
    EXPECT_EQ(punctured > 0, !b.options.layers.empty());
  }
}

TEST(CuttingTick, StepsAreBounded) {
  Bench b = body_of_64();
  int most = 0, evaluations = 0;
  for (int k = 0; k < 4000; k += 7) {  // 7 ms a tick: every one is hard
    b.tick(pose_at(k));
    most = std::max(most, b.out.steps);
    evaluations = std::max(evaluations, b.out.evaluations);
    ASSERT_TRUE(b.out.wrench_device.allFinite());
  }
  EXPECT_GT(most, 5);
  EXPECT_LE(most, b.options.max_steps);
  EXPECT_LE(evaluations, 13 * b.options.max_steps + 30);
}

// Holes of the cutting law outlive withdrawal (contract 4 of cutting_law.h).

constexpr double kHoleStep = 5e-5;

Bench hole_bench(std::size_t holes = 4) {
  Bench b(even_slabs(20, 1e-3, 20), holes);
  b.hold_shaft(200, 1e7, 1e6);
  b.options.coupling.translation_N_per_m = 1e5;
  return b;
}

double push_to(Bench& b, double x, double depth) {
  return b.peak_N(plate_at(x, -0.002), plate_at(x, depth), kHoleStep);
}
void pull_from(Bench& b, double x, double depth) {
  b.move(plate_at(x, depth), plate_at(x, -0.01), kHoleStep);
}

TEST(Hole, OutlivesWithdrawal) {
  Bench b = hole_bench();
  EXPECT_NEAR(push_to(b, 0, 0.015), 20, 1e-6);
  const double friction = b.out.wrench_device[2] - 20, depth = b.out.embedded_m, cut = b.cut_J;
  EXPECT_NEAR(friction, 200 * depth, 0.02 * friction);
  pull_from(b, 0, 0.015);
  EXPECT_EQ(b.out.embedded_m, 0);
  EXPECT_EQ(b.out.wrench_device.norm(), 0);
  EXPECT_LT(b.out.stored_J, 1e-18);

  // Again: no strength above the old bottom, but the friction and the walls of the hole.
  const double most = push_to(b, 0, 0.009);
  EXPECT_LT(most, 1e-9);
  EXPECT_EQ(b.cut_J, cut);
  EXPECT_NEAR(b.out.wrench_device[2], 200 * b.out.embedded_m, 0.02 * b.out.wrench_device[2]);
  EXPECT_GT(b.out.embedded_m, 0.008);
  b.move(plate_at(0, 0.009), plate_at(0.001, 0.009), kHoleStep);
  EXPECT_LT(b.out.wrench_device[0], -5);
  b.move(plate_at(0.001, 0.009), plate_at(0, 0.009), kHoleStep);

  // And at its bottom the bone.
  b.push(0.009, 0.02, kHoleStep);
  EXPECT_NEAR(b.out.tip_N, 20, 1e-6);
  EXPECT_GT(b.cut_J, cut + 0.01 * 0.02);
}

TEST(Hole, TheOldestIsForgotten) {
  Bench b = hole_bench(2);
  for (const double x : {0.0, 0.005, 0.01}) {
    EXPECT_NEAR(push_to(b, x, 0.01), 20, 1e-6);
    pull_from(b, x, 0.01);
  }
  EXPECT_LT(push_to(b, 0.005, 0.004), 1e-9);
  pull_from(b, 0.005, 0.004);
  EXPECT_NEAR(push_to(b, 0, 0.01), 20, 1e-6);
}

TEST(Hole, WithinTheReachOfAHoleTheToolGoesIntoIt) {
  Bench b = hole_bench();
  push_to(b, 0, 0.012);
  pull_from(b, 0, 0.012);
  EXPECT_LT(push_to(b, 4e-5, 0.008), 1e-9);
  pull_from(b, 4e-5, 0.008);
  EXPECT_NEAR(push_to(b, 2e-4, 0.008), 20, 1e-6);
}

// Each slab is reported once for each hole through it, however many a tick passes.
TEST(Hole, PassedSlabsAreReportedOnce) {
  for (const double step : {2e-5, 1e-4, 3e-3}) {
    for (const double thickness : {1e-3, 0.0}) {
      Bench b = hole_bench();
      for (std::size_t i = 0; i < b.slabs.size(); ++i)
        b.slabs[i].bottom_m = b.slabs[i].top_m + thickness;
      for (const double x : {0.0, 0.005}) {
        std::vector<int> passed(b.slabs.size());
        int next = 0;
        const auto note = [&](const CuttingResult& out, const Pose&) {
          if (out.passed_from == out.passed_to) return;
          EXPECT_EQ(out.passed_from, next);
          next = out.passed_to;
          for (int i = out.passed_from; i < out.passed_to; ++i)
            ++passed[static_cast<std::size_t>(i)];
        };
        b.tick(plate_at(x, -0.002));
        b.move(plate_at(x, -0.002), plate_at(x, 0.008), step, note);
        b.move(plate_at(x, 0.008), plate_at(x, -0.002), step, note);  // out and in between
        b.move(plate_at(x, -0.002), plate_at(x, 0.03), step, note);
        b.move(plate_at(x, 0.03), plate_at(x, -0.01), step, note);
        b.move(plate_at(x, -0.002), plate_at(x, 0.03), step, note);
        b.move(plate_at(x, 0.03), plate_at(x, -0.01), step, note);
        EXPECT_EQ(passed, std::vector<int>(b.slabs.size(), 1)) << step << " " << thickness;
      }
    }
  }
}

// Slanting from its old hole into whole bone, the tool cuts again where it leaves the hole.
TEST(Hole, LeftBySlanting) {
  Bench b = hole_bench();
  b.options.tool.tip_plate_m = {0, 0, -0.1};
  b.push(-0.102, -0.1 + 0.015, kHoleStep);
  b.push(-0.1 + 0.015, -0.102, kHoleStep);
  const double cut = b.cut_J;
  // 0.1 rad about the mouth of the hole.
  const auto slanting = [](double depth) {
    Pose X = plate_at(0, 0, 0.1);
    X.p_m = X.q * Eigen::Vector3d(0, 0, 0.1 - depth);
    return X;
  };
  EXPECT_NEAR(b.peak_N(slanting(-0.002), slanting(0.01), kHoleStep), 20, 1e-3);
  EXPECT_GT(b.cut_J, cut + 20 * 0.005);
}

// Down beside the bone without force, then against it from outside: the wall holds the tool, yields
// at its strength, and has then been pushed in.
TEST(Hole, BoneIsAWallFromOutside) {
  Slot beside;  // all of x < 2 mm
  beside.open({-1, -1}, 0);
  for (const Eigen::Vector2d& corner : {Eigen::Vector2d(0.002, -1), {0.002, 1}, {-1, 1}})
    beside.include(corner);
  Bench b = hole_bench();
  b.options.coupling.rotation_Nm_per_rad = 1e4;
  for (CuttingSlab& slab : b.slabs) {
    slab.share = 0;
    slab.friction_N_per_m = 0;
    slab.wall_strength_N_per_m = 2000;
    slab.free = &beside;
    slab.free_version = 1;
  }
  b.push(-0.002, 0.01, kHoleStep,
         [](const CuttingResult& out, const Pose&) { ASSERT_LT(out.wrench_device.norm(), 1e-12); });
  b.move(plate_at(0, 0.01), plate_at(0.0019, 0.01), kHoleStep);
  EXPECT_LT(b.out.wrench_device.norm(), 1e-12);
  double before = 0;
  b.move(plate_at(0.0019, 0.01), plate_at(0.004, 0.01), 1e-5,
         [&](const CuttingResult& out, const Pose&) {
           EXPECT_GE(-out.wrench_device[0], before - 1e-5);  // never through bone without force
           before = -out.wrench_device[0];
         });
  EXPECT_NEAR(before, 2000 * 0.01, 0.02 * 20);
  const double pushed = b.state.T_device_proxy.p_m.x();
  EXPECT_GT(pushed, 0.003);

  // A new outline from the geometry, without what was pushed in: no energy comes with it.
  const double stored = b.out.stored_J;
  for (CuttingSlab& slab : b.slabs)
    slab.free_version = 2;
  b.tick(plate_at(0.004, 0.01));
  EXPECT_LE(b.out.stored_J, stored + 1e-12);
  EXPECT_NEAR(-b.out.wrench_device[0], before, 0.01 * before);
}

// Soft layers over the bone, against closed forms (contract of soft_layer.h). Their energy is in
// cutting_energy_test.

// Ligamentum flavum: 11 N at 6.12 mm, where 500 z + 2.12e5 z^2 = 3.06 + 7.94.
SoftLayer ligament() {
  return soft_layer(0, 0.004, 500, 2.12e5, 11, 2, 200);
}
SoftLayer dura() {
  return soft_layer(0, 4e-4, 150, 1e4, 0.6, 0.1);
}
SoftLayer at_depth(SoftLayer layer, double top_m) {
  layer.bottom_m += top_m - layer.top_m;
  layer.top_m = top_m;
  return layer;
}

struct SoftBench : Bench {
  std::vector<SoftLayer> layers;
  SoftBench(std::vector<SoftLayer> soft, double bone_m, double bone_N = 60)
      : Bench(even_slabs(10, 1e-3, bone_N)), layers(std::move(soft)) {
    for (CuttingSlab& slab : slabs) {
      slab.top_m += bone_m;
      slab.bottom_m += bone_m;
    }
    options.layers = layers;
    state = make_cutting_state(slabs.size(), 4, layers.size());
  }
};

TEST(SoftLayer, StiffensAsItsClosedFormUntilThePuncture) {
  for (const bool is_rigid : {true, false}) {
    for (const double step : {1e-5, 1e-4, 1e-3}) {
      SoftBench b({ligament()}, 0.05);
      b.options.coupling.is_rigid = is_rigid;
      const SoftLayer& layer = b.layers[0];
      const double z_puncture = (-500 + std::sqrt(500 * 500 + 4 * 2.12e5 * 11)) / (2 * 2.12e5);
      EXPECT_NEAR(stretch_at(layer, 11), z_puncture, 1e-12);
      const double at_puncture = z_puncture + (is_rigid ? 0 : 11.0 / 4000);
      double peak = 0, at_peak = 0;
      b.push(-0.002, 0.01, step, [&](const CuttingResult& out, const Pose& X) {
        const double F = out.wrench_device[2], depth = -X.p_m.z();
        if (depth < 0) {
          EXPECT_EQ(F, 0);
        }
        if (depth > 0 && depth < at_puncture - 1e-9) {
          const double z = is_rigid ? depth : depth - F / 4000;
          EXPECT_NEAR(F, 500 * z + 2.12e5 * z * z, 1e-5) << depth;
        }
        if (F > peak) peak = F, at_peak = depth;
      });
      EXPECT_LE(peak, 11 + 1e-6);
      const double steepest = 500 + 2 * 2.12e5 * z_puncture;
      EXPECT_GE(peak, 11 - steepest * step - 1e-6);
      EXPECT_NEAR(at_peak, at_puncture, step + 1e-9);
    }
  }
}

// After it the cutting force and the friction of what is cut, until the bottom; then friction only.
TEST(SoftLayer, IsCutWithFrictionAfterThePuncture) {
  SoftLayer layer = ligament();
  layer.bottom_m = 0.02;
  SoftBench b({layer}, 0.1);
  b.push(-0.002, 0.0105, 1e-5);
  ASSERT_TRUE(b.state.layers[0].is_punctured);
  double work = 0, last_cut = 0;
  b.push(0.0105, 0.04, 1e-5, [&](const CuttingResult& out, const Pose&) {
    const double cut = b.state.layers[0].cut_m;
    if (cut < 0.02 - 1e-9) {
      EXPECT_NEAR(out.layer_N, 2, 1e-5);
      EXPECT_NEAR(out.wrench_device[2], 2 + 200 * cut, 2e-2);
      if (last_cut > 0) {
        EXPECT_NEAR(out.layer_cut_J, 2 * (cut - last_cut), 1e-10);
      }
      last_cut = cut;
      work += out.layer_cut_J;
    } else {
      EXPECT_EQ(out.layer_N, 0);
    }
  });
  EXPECT_NEAR(b.out.wrench_device[2], 200 * 0.02, 1e-4);
  EXPECT_GT(work, 0.8 * 2 * 0.01);
}

// The hole outlives withdrawal; beside it the layer is whole.
TEST(SoftLayer, RemembersItsHoles) {
  SoftBench b({ligament()}, 0.05);
  b.options.tool.radius_m = 5e-4;
  const auto peak = [&](double x) {
    double most = 0;
    b.move(plate_at(x, -0.002), plate_at(x, 0.015), 2e-5,
           [&](const CuttingResult& out, const Pose&) { most = std::max(most, out.layer_N); });
    b.move(plate_at(x, 0.015), plate_at(x, -0.002), 2e-5);
    EXPECT_LT(b.out.stored_J, 1e-15);
    EXPECT_EQ(b.out.wrench_device.norm(), 0);
    return most;
  };
  EXPECT_NEAR(peak(0), 11, 0.1);
  EXPECT_EQ(peak(0), 0);
  EXPECT_EQ(peak(3e-4), 0);  // within the tool's radius
  EXPECT_NEAR(peak(0.005), 11, 0.1);
  EXPECT_EQ(peak(0), 0);
  EXPECT_EQ(peak(0.005), 0);
}

// Withdrawn before the puncture a layer is as it was.
TEST(SoftLayer, IsElasticBeforeThePuncture) {
  SoftBench b({ligament()}, 0.05);
  for (int again = 0; again < 3; ++again) {
    b.push(-0.002, 0.006, 1e-4);
    EXPECT_GT(b.out.wrench_device[2], 4);
    EXPECT_NEAR(b.out.layer_N, b.out.wrench_device[2], 1e-5);
    b.push(0.006, -0.002, 1e-4);
    EXPECT_EQ(b.out.wrench_device[2], 0);
  }
  EXPECT_FALSE(b.state.layers[0].is_punctured);
  EXPECT_EQ(b.cut_J, 0);
}

// Lumbar puncture: ligament of 4 mm, 5 mm of epidural space, the dura, 10 mm on a vertebral body.
TEST(SoftLayer, LayersInSeriesOverBone) {
  SoftBench b({ligament(), at_depth(dura(), 0.009)}, 0.019, 60);
  b.options.coupling.is_rigid = true;
  std::vector<double> peaks;
  double before = 0;
  bool has_fallen = true;
  double ligament_at = 0, dura_at = 0, bone_at = 0;
  b.push(-0.001, 0.0235, 1e-5, [&](const CuttingResult& out, const Pose& X) {
    const double F = out.layer_N + out.tip_N, depth = -X.p_m.z();
    if (has_fallen && F < before - 0.3 && before > 0) {
      peaks.push_back(before);
      (peaks.size() == 1 ? ligament_at : dura_at) = depth;
      has_fallen = false;
    }
    has_fallen = has_fallen || F > before;
    if (bone_at == 0 && out.tip_N > 0) bone_at = depth;
    before = F;
  });
  ASSERT_EQ(peaks.size(), 2U);
  EXPECT_NEAR(peaks[0], 11, 0.05);
  EXPECT_NEAR(ligament_at, stretch_at(b.layers[0], 11), 2e-5);
  EXPECT_NEAR(peaks[1], 0.6, 0.01);
  EXPECT_NEAR(dura_at, 0.009 + stretch_at(b.layers[1], 0.6), 2e-5);
  // The bone begins where it is, not where a soft tip would have it.
  EXPECT_NEAR(bone_at, 0.019, 2e-5);
  EXPECT_NEAR(b.out.tip_N, 60, 1e-6);
}

// A ligament that fails at 6 mm over a dura at 4.5 mm: the dura tears with it, by what stretched
// the ligament.
TEST(SoftLayer, AThinLayerCloseBehindIsTornToo) {
  SoftLayer close = at_depth(dura(), 0.0045);
  SoftBench b({ligament(), close}, 0.1);
  b.options.coupling.is_rigid = true;
  b.push(-0.001, 0.0058, 1e-5);
  EXPECT_FALSE(b.state.layers[0].is_punctured);
  // Stretched by 1.3 mm: 0.21 N of its 0.6, but only through the ligament.
  EXPECT_NEAR(b.out.layer_N,
              soft_spring(b.layers[0], 0.0058).force_N + soft_spring(close, 0.0013).force_N, 1e-9);
  close.puncture_N = 0.2;
  b.layers[1] = close;
  b.push(0.0058, 0.0059, 1e-5);
  EXPECT_FALSE(b.state.layers[1].is_punctured);  // the ligament holds
  std::uint64_t punctured = 0;
  b.push(0.0059, 0.0063, 1e-5, [&](const CuttingResult& out, const Pose&) {
    EXPECT_EQ(punctured & out.layers_punctured, 0U) << "reported twice";
    punctured |= out.layers_punctured;
  });
  EXPECT_EQ(punctured, 0b11U);
  EXPECT_TRUE(b.state.layers[0].is_punctured);
  EXPECT_TRUE(b.state.layers[1].is_punctured);
}

// On bone that holds, a layer is squeezed until all that presses on it punctures it.
TEST(SoftLayer, IsPuncturedAgainstTheBone) {
  SoftBench b({ligament()}, 0.004);
  double most = 0;
  b.push(-0.002, 0.025, 1e-5, [&](const CuttingResult& out, const Pose&) {
    if (!b.state.layers[0].is_punctured) most = std::max(most, out.layer_N + out.tip_N);
  });
  EXPECT_NEAR(most, 11, 0.05);
  EXPECT_EQ(b.state.layers[0].cut_m, 0.004);
  EXPECT_EQ(b.out.layer_N, 0);
  EXPECT_NEAR(b.out.tip_N, 60, 1e-5);
}

}  // namespace
}  // namespace trocar::runtime
