// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <random>
#include <vector>

#include "runtime/haptics/bone/bone_volume.h"
#include "tests/runtime/haptics/bone/cutting_fixture.h"

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
    b.move(plate_at(0, -0.001), plate_at(0, 0.003), 1e-5);
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
    double max_N = 0;
    b.move(plate_at(0, 0.003), plate_at(0, 0.012), 1e-5,
           [&](const CuttingResult& out, const Pose&) { max_N = std::max(max_N, out.tip_N); });
    EXPECT_NEAR(max_N, 35, 0.06);
    EXPECT_EQ(b.out.tip_N, 0) << "broken";
  }
}

// The same sheet behind a coupling of 10 kN/m breaks at 10.5 mm of the device's depth; a shell of 1
// mm holds its 35 N for that much longer.
TEST(CuttingLaw, CouplingAndThicknessMoveTheBreak) {
  for (const bool has_coupling : {false, true}) {
    for (const double thickness : {0.0, 1e-3}) {
      Bench b(even_slabs(1, thickness, 35));
      b.options.coupling.is_rigid = !has_coupling;
      b.options.coupling.translation_N_per_m = 10'000;
      b.options.tip_N_per_m = 5000;
      double last_loaded = 0, peak = 0;
      b.move(plate_at(0, -0.001), plate_at(0, 0.014), 1e-5,
             [&](const CuttingResult& out, const Pose& X) {
               peak = std::max(peak, out.wrench_device[2]);
               if (out.wrench_device[2] > 1) last_loaded = -X.p_m.z();
             });
      EXPECT_NEAR(last_loaded, 0.007 + thickness + (has_coupling ? 0.0035 : 0), 1.1e-5);
      EXPECT_NEAR(peak, 35, 0.051);
      EXPECT_NEAR(b.cut_J, 35 * thickness, 1e-12);
    }
  }
}

// The front's work does not depend on speed or rate, and the force is the quasi-static one.
TEST(CuttingLaw, WorkIsThatOfTheStrength) {
  CuttingOptions options;
  options.coupling.translation_N_per_m = 4000;
  for (const double rate_Hz : {500.0, 1000.0, 2000.0, 4000.0, 8000.0}) {
    for (const double speed : {0.02, 0.2, 1.0}) {
      auto slabs = even_slabs(35, 1e-3, 0);
      for (std::size_t i = 0; i < slabs.size(); ++i) {
        slabs[i].strength_top_N = i == 0 ? 60 : slabs[i - 1].strength_bottom_N;
        slabs[i].strength_bottom_N = i < 3 ? 60 - 15.0 * static_cast<double>(i + 1)
                                           : 15 + 5 * std::sin(0.4 * static_cast<double>(i));
      }
      double expected = 0;
      for (const CuttingSlab& slab : slabs)
        expected += 0.5 * (slab.strength_top_N + slab.strength_bottom_N) * 1e-3;
      CuttingState state = state_for(slabs);
      CuttingResult out;
      double work = 0;
      for (int k = 0; speed * k / rate_Hz < 0.08; ++k) {
        cutting_tick(options, plate_at(0, speed * k / rate_Hz - 0.002), slabs, state, out);
        work += out.cut_J;
        ASSERT_TRUE(out.has_converged);
      }
      EXPECT_NEAR(work, expected, 1e-9 * expected) << rate_Hz << " " << speed;
      EXPECT_NEAR(out.wrench_device[2], 0, 1e-6);
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
    b.move(plate_at(0, -0.001), plate_at(0, 0.006), 1e-6,
           [&](const CuttingResult& out, const Pose&) {
             if (out.front_m > 0.8e-3 && out.front_m < 1.19e-3)
               upper_N = std::max(upper_N, out.tip_N);
             if (out.front_m > 1.3e-3 && out.front_m < 3.49e-3)
               inside_N = std::max(inside_N, out.tip_N);
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
    for (CuttingSlab& slab : b.slabs) {
      slab.friction_N_per_m = 300;
      slab.wall_N_per_m2 = 1e7;
      slab.wall_strength_N_per_m = 3e4;
      slab.clearance_m = clearance;
    }
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
  for (CuttingSlab& slab : b.slabs)
    slab.friction_N_per_m = kFriction_N_per_m;
  b.options.core_fraction = kFraction;
  b.options.core_growth_per_m = kGrowth_per_m;
  b.options.presliding_m = 1e-5;
  b.options.coupling.translation_N_per_m = 1e5;
  for (const double depth_m : {0.01, 0.02, 0.03}) {
    b.move(plate_at(0, depth_m - 0.0101), plate_at(0, depth_m), 1e-5);
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

}  // namespace
}  // namespace trocar::runtime
