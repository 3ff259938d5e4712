// SPDX-License-Identifier: Apache-2.0
#include "runtime/cutting/cutting_law.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <cstdio>
#include <vector>

namespace trocar::runtime {
namespace {

using Eigen::Vector3d;

Pose at(double x, double depth, double tilt = 0) {
  Pose T;
  T.p_m = {x, 0, -depth};
  T.q = from_rotation_vector({0, tilt, 0});
  return T;
}

std::vector<CuttingSlab> even_slabs(int count, double thickness, double strength) {
  std::vector<CuttingSlab> slabs(static_cast<std::size_t>(count));
  for (int i = 0; i < count; ++i) {
    CuttingSlab& slab = slabs[static_cast<std::size_t>(i)];
    slab.top_m = i * thickness;
    slab.bottom_m = (i + 1) * thickness;
    slab.strength_top_N = slab.strength_bottom_N = strength;
  }
  return slabs;
}

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
        cutting_tick(options, at(0, depth), slabs, state, out);
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

// The front's work does not depend on speed or rate, and the force is the quasi-static one.
TEST(CuttingLaw, WorkIsThatOfTheStrength) {
  CuttingOptions options;
  options.coupling.translation_N_per_m = 4000;
  for (const double rate_Hz : {500.0, 1000.0, 2000.0, 4000.0, 8000.0}) {
    for (const double speed : {0.02, 0.2, 1.0}) {
      auto slabs = even_slabs(35, 1e-3, 0);
      for (std::size_t i = 0; i < slabs.size(); ++i) {
        slabs[i].strength_top_N = i == 0 ? 60 : slabs[i - 1].strength_bottom_N;
        slabs[i].strength_bottom_N = i < 3 ? 60 - 15.0 * static_cast<double>(i + 1) : 15 + 5 * std::sin(0.4 * static_cast<double>(i));
      }
      double expected = 0;
      for (const CuttingSlab& slab : slabs)
        expected += 0.5 * (slab.strength_top_N + slab.strength_bottom_N) * 1e-3;
      CuttingState state = state_for(slabs);
      CuttingResult out;
      double work = 0;
      for (int k = 0; speed * k / rate_Hz < 0.08; ++k) {
        cutting_tick(options, at(0, speed * k / rate_Hz - 0.002), slabs, state, out);
        work += out.cut_J;
        ASSERT_TRUE(out.has_converged);
      }
      EXPECT_NEAR(work, expected, 1e-9 * expected) << rate_Hz << " " << speed;
      EXPECT_NEAR(out.wrench_device[2], 0, 1e-6);
    }
  }
}

// A rigid rod in an elastic bed, pushed sideways (closed form; the walls have no strength limit).
TEST(CuttingLaw, RodInElasticBed) {
  for (const double thickness : {5e-4, 1e-3, 2e-3}) {
    CuttingOptions options;
    options.tool.tip_plate_m = {0, 0, -0.1};
    options.coupling.translation_N_per_m = 1e5;
    options.coupling.rotation_Nm_per_rad = 1e-3;  // a hand that holds a point
    options.tip_N_per_m = 1e5;
    options.most_steps = 60;
    options.tolerance = 1e-9;
    const double kappa = 2e8, embedded = 0.01;
    auto slabs = even_slabs(static_cast<int>(0.01 / thickness + 0.5), thickness, 1e-3);
    for (CuttingSlab& slab : slabs) {
      slab.wall_N_per_m2 = kappa;
      slab.wall_strength_N_per_m = 1e9;
    }
    CuttingState state = state_for(slabs);
    CuttingResult out;
    for (int k = 0; k <= 120; ++k)
      cutting_tick(options, at(0, -0.1 - 0.001 + 1e-4 * k), slabs, state, out);
    EXPECT_NEAR(out.embedded_m, embedded, 1e-9);
    for (int k = 1; k <= 50; ++k)
      cutting_tick(options, at(4e-5 * k, -0.1 + 0.011), slabs, state, out);
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

struct Scenario {
  CuttingOptions options;
  std::vector<CuttingSlab> slabs;
};

Scenario random_run(std::mt19937& random) {
  const auto uniform = [&](double a, double b) { return std::uniform_real_distribution<double>(a, b)(random); };
  const auto power = [&](double a, double b) { return std::pow(10.0, uniform(a, b)); };
  Scenario run;
  run.slabs = even_slabs(static_cast<int>(uniform(1, 40)), power(-3.6, -2.7), 0);
  const double friction = uniform(0, 300), wall = power(5.5, 8), strength = power(3, 4.7);
  const double clearance = uniform(0, 1) < 0.5 ? 0 : power(-5, -3.7);
  double before = uniform(5, 100);
  for (CuttingSlab& slab : run.slabs) {
    slab.strength_top_N = before;
    slab.strength_bottom_N = before = uniform(0, 1) < 0.2 ? uniform(0, 100) : before * uniform(0.8, 1.1);
    slab.friction_N_per_m = friction;
    slab.wall_N_per_m2 = wall;
    slab.wall_strength_N_per_m = strength;
    slab.clearance_m = clearance;
  }
  if (uniform(0, 1) < 0.2)
    for (CuttingSlab& slab : run.slabs)
      slab.bottom_m = slab.top_m + uniform(0, 1) * (slab.bottom_m - slab.top_m);
  run.options.tool.tip_plate_m = {0, 0, -uniform(0.05, 0.15)};
  run.options.coupling.translation_N_per_m = power(3, 4.5);
  run.options.coupling.rotation_Nm_per_rad = power(0.5, 2);
  if (uniform(0, 1) < 0.5) {
    run.options.coupling.most_force_N = uniform(5, 60);
    run.options.coupling.most_moment_Nm = uniform(0.2, 3);
  }
  run.options.coupling.is_rigid = uniform(0, 1) < 0.15;
  run.options.tip_N_per_m = power(3.7, 6.3);
  run.options.presliding_m = power(-5, -3.5);
  run.options.most_steps = uniform(0, 1) < 0.2 ? static_cast<int>(uniform(1, 4)) : 12;
  return run;
}

// Contract 1, with prescribed motions that push, withdraw, drag sideways, tilt and twist.
TEST(CuttingLaw, NoTickGivesEnergy) {
  std::mt19937 random(11);
  const auto uniform = [&](double a, double b) { return std::uniform_real_distribution<double>(a, b)(random); };
  double worst = -1;
  long ticks = 0, cut = 0, unconverged = 0, steps = 0;
  for (int n = 0; n < 400; ++n) {
    Scenario run = random_run(random);
    CuttingState state = state_for(run.slabs);
    CuttingResult out;
    const double lever = -run.options.tool.tip_plate_m.z();
    const double depth = uniform(0.002, 0.05), speed = std::pow(10.0, uniform(-1.7, 0));
    const double side = std::pow(10.0, uniform(-4, -1.8)), tilt = uniform(-0.3, 0.3), turn = uniform(0, 2);
    const double f1 = uniform(0.5, 8), f2 = uniform(0.5, 8);
    Pose before;
    Wrench w = Wrench::Zero();
    double stored = 0;
    const double dt = 1e-3;
    for (int k = 0; k < 600; ++k) {
      const double t = k * dt;
      double d = std::min(speed * t, depth) - 0.002;
      if (n % 4 == 1) d = depth * (0.5 - 0.5 * std::cos(6.28 * f1 * t)) * 1.2 - 0.002;
      if (n % 4 == 2 && t > 0.4) d -= speed * (t - 0.4);
      Pose X;
      X.q = from_rotation_vector({0.3 * tilt * std::sin(f2 * t), tilt * std::min(t * 3, 1.0), turn * std::sin(6.28 * f1 * t)});
      const Vector3d tip(side * std::sin(6.28 * f2 * t) * std::min(3 * t, 1.0), 0.3 * side * std::sin(5 * t), -d);
      X.p_m = tip - X.q * Vector3d(0, 0, -lever);
      cutting_tick(run.options, X, run.slabs, state, out);
      ASSERT_TRUE(out.wrench_device.allFinite());
      if (k > 0) {
        const Twist dx = displacement(before, X);
        const double done = -w.dot(dx);
        double leak = 0.5 * run.options.coupling.translation_N_per_m * dx.head<3>().squaredNorm() +
                      0.5 * run.options.coupling.rotation_Nm_per_rad * dx.tail<3>().squaredNorm();
        if (run.options.coupling.is_rigid) leak = INFINITY;
        const double excess = out.stored_J - stored - done - leak;
        worst = std::max(worst, excess);
        ASSERT_LE(excess, 1e-12) << "run " << n << " tick " << k;
      }
      before = X;
      w = out.wrench_device;
      stored = out.stored_J;
      ++ticks;
      cut += out.cut_J > 0;
      unconverged += !out.has_converged && run.options.most_steps >= 12;
      steps += out.steps;
    }
  }
  std::printf("worst excess %g J, %ld ticks, %ld cut, %ld not converged, %.2f steps a tick\n", worst, ticks, cut, unconverged,
              static_cast<double>(steps) / static_cast<double>(ticks));
}

}  // namespace
}  // namespace trocar::runtime
