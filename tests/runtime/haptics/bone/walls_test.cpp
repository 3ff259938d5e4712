// SPDX-License-Identifier: Apache-2.0
// The walls' part of the potential against the sum over all Gauss points one by one.
#include "runtime/haptics/bone/walls.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

#include "runtime/haptics/bone/tick.h"
#include "tests/runtime/haptics/bone/cutting_fixture.h"

namespace trocar::runtime {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr int kSlabs = 20;
constexpr double kThickness_m = 1e-3, kLever_m = 0.1;

struct Walls {
  double energy = 0;
  Evaluation::Vector6 g = Evaluation::Vector6::Zero();
  Evaluation::Matrix6 H = Evaluation::Matrix6::Zero();
  bool yields = false;
};

// A crossing at depth z moves by J w for a small displacement w of the proxy; Gauss-Newton.
Walls one_by_one(const CuttingHole& hole, int from, int to, const Vector3d& plate,
                 const Vector3d& tip, const Vector3d& axis) {
  Walls out;
  for (int i = from; i < to; ++i) {
    const CuttingHoleSlab& s = hole.slabs[static_cast<std::size_t>(i)];
    if (s.wall_N_per_m <= 0) continue;
    for (std::size_t g = 0; g < kMaxWallPoints; ++g) {
      const Vector2d at = crossing(tip, axis, s.depth_m[g]);
      const Slot::Reach r = s.walls[g].reach(at);
      if (r.distance_m <= 0) continue;
      const YieldSpring h = yield_spring(s.wall_N_per_m, s.wall_most_N, r.distance_m, false);
      out.energy += h.energy;
      out.yields = out.yields || s.wall_N_per_m * r.distance_m > s.wall_most_N;
      const Vector3d from_plate = Vector3d(at.x(), at.y(), -s.depth_m[g]) - plate;
      Eigen::Matrix<double, 2, 6> J;
      for (int c = 0; c < 6; ++c) {
        const Vector3d moves =
            c < 3 ? Vector3d(Vector3d::Unit(c)) : Vector3d(Vector3d::Unit(c - 3).cross(from_plate));
        // Back into the plane, along the shaft.
        J.col(c) = (moves - axis * (moves.z() / axis.z())).head<2>();
      }
      const Vector2d away = r.away, across(-away.y(), away.x());
      out.g += J.transpose() * (h.force * away);
      out.H +=
          J.transpose() *
          (h.along * away * away.transpose() + r.bend * h.across * across * across.transpose()) * J;
    }
  }
  return out;
}

// Holes of all kinds of slots, limits and clearances; poses that go on by steps of all sizes.
TEST(Walls, SumOfAllPoints) {
  std::mt19937 random(1);
  std::normal_distribution<double> normal(0, 1);
  std::uniform_real_distribution<double> uniform(0, 1);
  int yielding = 0, summed = 0, single = 0;
  for (int run = 0; run < 400; ++run) {
    CuttingOptions options;
    options.tool.tip_plate_m = {0, 0, -kLever_m};
    std::vector<CuttingSlab> slabs(kSlabs);
    CuttingState state = make_cutting_state(kSlabs, 1);
    state.hole = 0;
    state.embedded_from = run % 3;
    state.embedded_to = kSlabs - run % 4;
    for (int i = 0; i < kSlabs; ++i) {
      slabs[static_cast<std::size_t>(i)].top_m = i * kThickness_m;
      slabs[static_cast<std::size_t>(i)].bottom_m = (i + 1) * kThickness_m;
      CuttingHoleSlab& s = state.holes[0].slabs[static_cast<std::size_t>(i)];
      s.wall_N_per_m = i % 7 == 5 ? 0 : 5e3 * uniform(random);
      s.wall_most_N = run % 4 == 0 ? 1e9 : s.wall_N_per_m * 2e-4 * uniform(random);
      for (std::size_t g = 0; g < kMaxWallPoints; ++g) {
        s.depth_m[g] = gauss_depth(slabs[static_cast<std::size_t>(i)], g);
        s.walls[g].open({1e-4 * normal(random), 1e-4 * normal(random)}, run % 5 == 0 ? 5e-5 : 0);
        for (int k = static_cast<int>(6 * uniform(random) * uniform(random)); k > 0; --k)
          s.walls[g].include({2e-4 * normal(random), 2e-4 * normal(random)});
      }
    }
    Pose plate;
    plate.p_m = {1e-4 * normal(random), 1e-4 * normal(random), kLever_m - 0.02};
    plate.q = from_rotation_vector({3e-3 * normal(random), 3e-3 * normal(random), normal(random)});
    Tick tick{.options = options, .plate = plate, .slabs = slabs, .state = state, .layers = {}};
    const double usual_step_m = std::pow(10.0, -4 - 4 * uniform(random));
    for (int k = 0; k < 30; ++k) {
      if (k % 10 == 9) {
        state.holes[0].slabs[7].walls[0].include({2e-4 * normal(random), 2e-4 * normal(random)});
        tick.walls.forget();
      }
      // Mostly of one size, to which the reach of the sums adapts; by turns about a depth in the
      // hole, so that its ends move apart.
      const double step_m = (k % 11 == 10 ? 100 : uniform(random)) * usual_step_m;
      const Vector3d pivot(0, 0, -0.02 * uniform(random));
      const Eigen::Quaterniond turn = from_rotation_vector(
          step_m / 5e-3 * Vector3d(normal(random), normal(random), normal(random)));
      plate.p_m = pivot + turn * (plate.p_m - pivot) +
                  step_m * Vector3d(normal(random), normal(random), normal(random));
      plate.q = (turn * plate.q).normalized();
      const Vector3d axis = plate.q * options.tool.inward_plate,
                     lever = plate.q * options.tool.tip_plate_m, tip = plate.p_m + lever;
      Evaluation e;
      add_walls(tick, tip, axis, lever, false, e);
      const Walls expected =
          one_by_one(state.holes[0], state.embedded_from, state.embedded_to, plate.p_m, tip, axis);
      ASSERT_NEAR(e.wall_J, expected.energy, 1e-12 * (1e-3 + expected.energy)) << run << " " << k;
      ASSERT_EQ(e.walls_yield, expected.yields);
      const double force = expected.g.norm();
      ASSERT_LE((e.g - expected.g).norm(), 1e-9 * (0.1 + force)) << run << " " << k;
      ASSERT_LE((e.H - expected.H).norm(), 1e-7 * (1e3 + expected.H.norm())) << run << " " << k;
      yielding += e.walls_yield;
      single += static_cast<int>(tick.walls.others());
      summed +=
          static_cast<int>(2 * (state.embedded_to - state.embedded_from) - tick.walls.others());
    }
  }
  EXPECT_GT(yielding, 1000);
  EXPECT_GT(summed, 50'000);
  EXPECT_GT(single, 50'000);
}

}  // namespace
}  // namespace trocar::runtime
