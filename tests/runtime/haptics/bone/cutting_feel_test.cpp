// SPDX-License-Identifier: Apache-2.0
// What the hand feels by the cutting law: the quasi-static force at every rate, no gaps in bone,
// guidance by the hole, and no energy from a device that is damped enough.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

#include "tests/runtime/haptics/bone/cutting_fixture.h"

namespace trocar::runtime {
namespace {

using Eigen::Vector3d;

// 35 mm of a vertebra in slabs of 1 mm: a shell, cancellous bone that varies, a far shell.
std::vector<CuttingSlab> vertebra() {
  std::vector<CuttingSlab> slabs = even_slabs(35, 1e-3, 0);
  for (int i = 0; i < 35; ++i) {
    const auto Y = [](int at) { return 15 + 5 * std::sin(0.4 * at); };
    CuttingSlab& slab = slabs[static_cast<std::size_t>(i)];
    slab.strength_top_N = i < 2 || i == 33 ? 60 : Y(i);
    slab.strength_bottom_N = i < 2 || i == 33 ? 60 : Y(i + 1);
  }
  return slabs;
}
double strength_at(const std::vector<CuttingSlab>& slabs, double depth) {
  for (const CuttingSlab& s : slabs)
    if (depth >= s.top_m && depth < s.bottom_m)
      return s.strength_top_N +
             (s.strength_bottom_N - s.strength_top_N) * (depth - s.top_m) / (s.bottom_m - s.top_m);
  return 0;
}

constexpr std::array<double, 5> kRates_Hz{500, 1000, 2000, 4000, 8000};
constexpr std::array<double, 3> kSpeeds{0.02, 0.2, 1.0};

// Reference: the front in steps of 20 nm to the first place where tip and coupling in series press
// no harder than the strength there, at most kMostCut_m in a tick.
TEST(CuttingFeel, ForceAtTicksIsTheQuasiStaticOne) {
  const std::vector<CuttingSlab> body = vertebra();
  for (const double rate : kRates_Hz) {
    for (const double speed : kSpeeds) {
      if (rate / speed > 1e5) continue;  // 70,000 ticks and more
      Bench b(body);
      const double series =
          1 / (1 / b.options.coupling.translation_N_per_m + 1 / b.options.tip_N_per_m);
      double front = 0;
      constexpr double kFine = 2e-8;
      for (int k = 0; speed * k / rate < 0.06; ++k) {
        const double x = speed * k / rate - 0.00200123;  // no tick where the shell just breaks
        b.tick(plate_at(0, x));
        const double most = std::min(0.035, front + most_cut_m(b.options.interval_s));
        while (front < most && series * (x - front) > strength_at(body, front))
          front = std::min(front + kFine, most);
        // The reference's own step shows in its front, not more.
        const double F = front >= 0.035 ? 0 : series * std::max(x - front, 0.0);
        ASSERT_NEAR(b.out.wrench_device[2], F, 1e-6 * 60 + series * kFine)
            << rate << " Hz " << speed << " m/s at " << x;
      }
    }
  }
}

// A needle that enters at 10 degrees and is pushed along its axis goes on at 10 degrees.
TEST(CuttingFeel, TheHoleGuides) {
  for (const double clearance : {0.0, 5e-5}) {
    Bench b(even_slabs(40, 1e-3, 20));
    b.options.tool.tip_plate_m = {0, 0, -0.1};
    b.hold_shaft(200, 5e7, 2e4, clearance);
    const double tilt = 10 * std::numbers::pi / 180;
    const Pose from = plate_at(0, -0.105, tilt);
    const Vector3d inward = from.q * -Vector3d::UnitZ();
    Pose to = from;
    to.p_m += inward * 0.05;
    double worst = 0, deepest = 0;
    b.move(from, to, 1e-4, [&](const CuttingResult& out, const Pose&) {
      const Vector3d axis = b.state.T_device_proxy.q * -Vector3d::UnitZ();
      worst = std::max(worst, std::acos(std::min(1.0, axis.dot(inward))));
      deepest = std::max(deepest, out.embedded_m);
    });
    EXPECT_GT(deepest, 0.03);
    EXPECT_LT(worst * 180 / std::numbers::pi, 0.05) << clearance;
  }
}

// A device in a hand, with the force held over the tick. Its own damping b >= K T / 2 takes what
// holding leaks, so that the hand never has more back than it and the damping put in.
struct SimpleDevice {
  double mass, inertia, b_m, b_r;
  Pose X;
  Twist v = Twist::Zero();
  double given_J = 0, damped_J = 0;  // by the law to the plate; by the damping
  void move(const Wrench& w, const Twist& hand, double T) {
    const Vector3d a = (w.head<3>() + hand.head<3>() - b_m * v.head<3>()) / mass;
    v.head<3>() += a * T / (1 + b_m * T / mass);
    // One turn a tick, so that the held moment's work is that of its displacement.
    const Vector3d n = (w.tail<3>() + hand.tail<3>() - b_r * v.tail<3>()) / inertia;
    v.tail<3>() += n * T / (1 + b_r * T / inertia);
    X.p_m += v.head<3>() * T;
    X.q = (from_rotation_vector(v.tail<3>() * T) * X.q).normalized();
    given_J += w.dot(v) * T;
    damped_J += (b_m * v.head<3>().squaredNorm() + b_r * v.tail<3>().squaredNorm()) * T;
  }
};

// `damping_share`: of K T / 2; `ahead`: ticks by which the law's pose is predicted; with `soft`
// there are layers over the bone, and the tip has friction.
double most_given(std::mt19937& random, double damping_share, double ahead = 0, bool soft = false) {
  const auto uniform = [&](double a, double b) {
    return std::uniform_real_distribution<double>(a, b)(random);
  };
  const auto power = [&](double a, double b) { return std::pow(10.0, uniform(a, b)); };
  Bench b(vertebra());
  b.options.tool.tip_plate_m = {0, 0, -0.1};
  b.options.coupling.translation_N_per_m = power(3.3, 4.5);
  b.options.coupling.rotation_Nm_per_rad = power(1, 2);
  b.options.tip_N_per_m = power(3.7, 6.3);
  if (uniform(0, 1) < 0.5) b.options.coupling.max_force_N = uniform(20, 80);
  const double friction = uniform(0, 300), wall = power(5.5, 8), strength = power(3, 4.7),
               scale = uniform(0.2, 1.2);
  b.hold_shaft(friction, wall, strength);
  for (CuttingSlab& slab : b.slabs) {
    slab.strength_top_N *= scale;
    slab.strength_bottom_N *= scale;
  }
  std::vector<SoftLayer> layers;
  if (soft) {
    b.options.tip_friction = uniform(0, 0.6);
    b.options.tip_hold = uniform(0, 1);
    const double stiffness = power(2, 3.3), stiffening = power(4, 5.7), puncture_N = uniform(2, 15),
                 cutting_N = uniform(0, 2), layer_friction = uniform(0, 200);
    layers = {
        soft_layer(-0.001, 0.002, stiffness, stiffening, puncture_N, cutting_N, layer_friction),
        soft_layer(0.003, 0.0035, 150, 1e4, 0.6, 0.1)};
    b.options.layers = layers;
    b.state = make_cutting_state(b.slabs.size(), 4, layers.size());
  }
  const double T = 1 / power(2.7, 3.9);
  SimpleDevice d{.mass = power(-1, 0.7),
                 .inertia = 0,
                 .b_m = damping_share * b.options.coupling.translation_N_per_m * T / 2,
                 .b_r = damping_share * b.options.coupling.rotation_Nm_per_rad * T / 2,
                 .X = plate_at(0, -0.105)};
  d.inertia = 2e-3 * (1 + d.mass);
  if (uniform(0, 1) < 0.3) d.v[2] = -uniform(0.3, 3);
  if (ahead > 0) {  // K T^2 / M up to 0.5, for translation and rotation
    const CuttingCoupling& c = b.options.coupling;
    d.mass = std::max(d.mass, c.translation_N_per_m * T * T / 0.5);
    d.inertia = std::max(d.inertia, c.rotation_Nm_per_rad * T * T / 0.5);
  }
  Pose before = d.X;
  const double spring = uniform(0, 1) < 0.3 ? uniform(0, 300) : uniform(0, 8000),
               turn = uniform(0, 60), depth = uniform(0.005, 0.045), f = uniform(0.5, 10),
               side = power(-4, -2), lean = uniform(-0.2, 0.2);
  double most = 0;
  for (int k = 0; k * T < 0.4; ++k) {
    const double t = k * T;
    Pose aim = plate_at(0, 0, lean * std::min(3 * t, 1.0) * std::cos(3 * t));
    aim.p_m = Vector3d(side * std::sin(6.28 * f * t), 0, -depth * (0.6 - 0.6 * std::cos(9 * t))) -
              aim.q * b.options.tool.tip_plate_m;
    const Vector3d axis = d.X.q * b.options.tool.inward_plate;
    if (d.X.p_m.norm() > 1 || axis.z() > -0.75) break;
    const Twist step = ahead * displacement(before, d.X);
    before = d.X;
    b.tick({d.X.p_m + step.head<3>(), from_rotation_vector(step.tail<3>()) * d.X.q});
    Twist e = displacement(d.X, aim), hand;
    hand << spring * e.head<3>(), turn * e.tail<3>();
    d.move(b.out.wrench_device, hand, T);
    most = std::max(most, d.given_J - d.damped_J);
  }
  return most;
}

TEST(CuttingFeel, ADampedDeviceIsGivenNothing) {
  std::mt19937 random(3);
  double worst = 0, worst_undamped = 0;
  for (int n = 0; n < 150; ++n)
    worst = std::max(worst, most_given(random, 1));
  for (int n = 0; n < 100; ++n)
    worst = std::max(worst, most_given(random, 1, 0, true));
  EXPECT_LE(worst, 1e-9);
  for (int n = 0; n < 60; ++n)
    worst_undamped = std::max(worst_undamped, most_given(random, 0));
  EXPECT_GT(worst_undamped, 1e-4);  // such sessions without it: the bound is tried
}

// If the damping is too small, the law is evaluated at a predicted pose. This bound is measured, not proved.
TEST(CuttingFeel, APredictedPoseGivesNothingWithoutDamping) {
  std::mt19937 random(4);
  for (const double ahead : {0.75, 1.0}) {
    double worst = 0;
    for (int n = 0; n < 100; ++n)
      worst = std::max(worst, most_given(random, 0, ahead));
    EXPECT_LE(worst, 1e-9) << ahead;
    for (int n = 0; n < 100; ++n)
      worst = std::max(worst, most_given(random, 0, ahead, true));
    EXPECT_LE(worst, 1e-9) << ahead << ", soft layers";
  }
  double worst = 0;
  for (int n = 0; n < 100; ++n)
    worst = std::max(worst, most_given(random, 0, 0.5));
  EXPECT_GT(worst, 1e-6);  // half a tick is not enough
}

}  // namespace
}  // namespace trocar::runtime
