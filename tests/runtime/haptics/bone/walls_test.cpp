// SPDX-License-Identifier: Apache-2.0
// The region of a hole, and the walls' part of the potential.
#include "runtime/haptics/bone/walls.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <random>
#include <vector>

#include "runtime/haptics/bone/tick.h"
#include "tests/runtime/haptics/bone/cutting_fixture.h"

namespace trocar::runtime {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

// The second corner would be the first one by rounding.
TEST(Slot, SegmentOfNoLength) {
  Slot slot;
  const double at = 0.05, x = 0.051;
  slot.open({at, 0}, std::nextafter(x - at, 0));
  slot.include({x, 0});
  ASSERT_EQ(slot.corners(), 1);
  const Slot::Reach r = slot.reach({at, 2e-3});
  EXPECT_NEAR(r.distance_m, 1e-3, 1e-15);
  EXPECT_NEAR((r.away - Vector2d(0, 1)).norm(), 0, 1e-15);
  EXPECT_NEAR(r.bend, 0.5, 1e-12);
}

// An estimator or a hand exactly along the axis moves the shaft by as little as a number can say. The
// square of such a distance underflows, and a stiffness divided by it is infinite.
TEST(Slot, ADistanceWhoseSquareUnderflowsMakesNoEdge) {
  for (int exponent = -320; exponent <= -10; ++exponent) {
    const double tiny_m = std::pow(10.0, exponent);
    for (const double clearance_m : {0.0, 1e-5}) {
      for (int corners = 1; corners <= 4; ++corners) {
        Slot slot;
        slot.open({0, 0}, clearance_m);
        const std::array<Vector2d, 4> steps{Vector2d(tiny_m, 0), Vector2d(tiny_m, tiny_m),
                                            Vector2d(-tiny_m, 2 * tiny_m), Vector2d(0, -tiny_m)};
        for (int i = 0; i < corners; ++i)
          slot.include(clearance_m * Vector2d(1, 0) + steps[static_cast<std::size_t>(i)]);
        for (const Vector2d& p : {Vector2d(tiny_m / 2, 1e-3), Vector2d(-1e-3, tiny_m / 2),
                                  Vector2d(tiny_m / 2, tiny_m / 3), Vector2d(0, 0)}) {
          const Slot::Reach r = slot.reach(p);
          ASSERT_TRUE(std::isfinite(r.distance_m) && r.away.allFinite() && std::isfinite(r.bend));
          ASSERT_NEAR(r.distance_m, std::max(0.0, p.norm() - clearance_m), 1e-9) << exponent;
          slot.nearest(
              p, 1e-9, [&](const Vector2d& offset) { return offset.allFinite(); },
              [&](const Vector2d& offset, const Vector2d& edge, double edge2) {
                EXPECT_TRUE(offset.allFinite()) << exponent;
                // The wall's stiffness across the edge, as in walls.cpp.
                EXPECT_NEAR(1e8 / edge2 * edge.x() * edge.x() + 1e8 / edge2 * edge.y() * edge.y(),
                            1e8, 1)
                    << exponent;
                return true;
              });
        }
      }
    }
  }
}

// Against the distance to the hull of all points by brute force: the region is never smaller, and
// while the corners suffice it is the same.
TEST(Slot, OnlyWidens) {
  std::mt19937 random(5);
  std::normal_distribution<double> normal(0, 1e-3);
  for (int run = 0; run < 300; ++run) {
    Slot slot;
    const double clearance = run % 2 ? 5e-5 : 0;
    // Regions as thin as rounding, too, and not at the origin.
    const double thin = run % 3 == 0 ? std::pow(10.0, -run % 19) : 1;
    const Vector2d at = run % 5 == 0 ? Vector2d(0, 0) : Vector2d(0.02, -0.07);
    slot.open(at, clearance);
    std::vector<Vector2d> probes(60);
    std::vector<double> before(probes.size());
    for (std::size_t i = 0; i < probes.size(); ++i) {
      probes[i] = at + Vector2d(3 * normal(random), 3 * normal(random) * (i % 2 ? thin : 1));
      before[i] = slot.reach(probes[i]).distance_m;
    }
    for (int step = 0; step < 40; ++step) {
      const Vector2d p = at + Vector2d(normal(random), thin * normal(random));
      slot.include(p);
      ASSERT_NEAR(slot.reach(p).distance_m, 0, 1e-12);
      for (std::size_t i = 0; i < probes.size(); ++i) {
        const double now = slot.reach(probes[i]).distance_m;
        ASSERT_LE(now, before[i] + 1e-12);
        before[i] = now;
      }
    }
  }
}

// The reach's direction and bend are the derivatives of distance^2 / 2.
TEST(Slot, Derivatives) {
  std::mt19937 random(6);
  std::normal_distribution<double> normal(0, 1);
  for (int run = 0; run < 500; ++run) {
    Slot slot;
    slot.open({0, 0}, run % 3 == 0 ? 0.1 : 0);
    for (int k = 0; k < run % 6; ++k)
      slot.include({normal(random), normal(random)});
    const Vector2d p(3 * normal(random), 3 * normal(random));
    const Slot::Reach r = slot.reach(p);
    if (r.distance_m < 0.05) continue;
    const auto half2 = [&](const Vector2d& at) {
      const double d = slot.reach(at).distance_m;
      return d * d / 2;
    };
    const double h = 1e-4;
    const Vector2d along = r.away, across(-along.y(), along.x());
    EXPECT_NEAR((half2(p + h * along) - half2(p - h * along)) / (2 * h), r.distance_m, 1e-6);
    EXPECT_NEAR((half2(p + h * across) - half2(p - h * across)) / (2 * h), 0, 1e-3);
    const double bend = (half2(p + h * across) - 2 * half2(p) + half2(p - h * across)) / (h * h);
    if (slot.reach(p + h * across).bend == slot.reach(p - h * across).bend || r.bend > 0) {
      EXPECT_NEAR(bend, r.bend, 2e-2) << run;
    }
  }
}

// A result of nearest() agrees with offset(), and nearest() has a result for most points.
TEST(Slot, NearestPartStaysSoWithinReach) {
  std::mt19937 random(8);
  std::normal_distribution<double> normal(0, 1e-3);
  std::uniform_real_distribution<double> uniform(0, 1);
  enum { kCorner, kEdge, kInside, kUnknown };
  std::array<int, 4> seen{};
  for (int run = 0; run < 20000; ++run) {
    Slot slot;
    const Vector2d at(0.02, -0.07);
    slot.open(at, run % 2 ? 1e-4 : 0);
    for (int k = 0; k < run % 7; ++k)
      slot.include(at + Vector2d(normal(random), (run % 3 ? 1 : 1e-6) * normal(random)));
    const double reach = std::pow(10.0, -3 - 6 * uniform(random));
    const double spread = run % 5 == 0 ? 0.2 : 2;
    const Vector2d p = at + spread * Vector2d(normal(random), normal(random));
    slot.offset(p);
    int part = kInside;
    Vector2d from = Vector2d::Zero(), along = Vector2d::Zero();
    const bool known = slot.nearest(
        p, reach,
        [&](const Vector2d& offset) {
          part = kCorner;
          from = offset;
          return true;
        },
        [&](const Vector2d& offset, const Vector2d& edge, double length2) {
          part = kEdge;
          from = offset;
          along = edge / std::sqrt(length2);
          return true;
        });
    ++seen[known ? part : kUnknown];
    if (!known) continue;
    for (int k = 0; k < 20; ++k) {
      const double turn = 6.2832 * uniform(random);
      const Vector2d step =
          (k == 0 ? 0 : reach * uniform(random)) * Vector2d(std::cos(turn), std::sin(turn));
      Vector2d expected = from;
      if (part == kCorner) expected += step;
      if (part == kEdge) expected += step - along * along.dot(step);
      const Slot::Offset found = slot.offset(p + step);
      ASSERT_LE((Vector2d(found.x_m, found.y_m) - expected).norm(), 1e-14) << run;
    }
  }
  EXPECT_GT(seen[kCorner], 5000);
  EXPECT_GT(seen[kEdge], 1000);
  EXPECT_GT(seen[kInside], 500);
  EXPECT_LT(seen[kUnknown], 8000);
}

// A region that is all but a line, as a tool leaves that is pushed along one: beyond its end the
// distance is that from the end, whatever the signs of areas that are rounding.
TEST(Slot, AllButALine) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> uniform(0, 1);
  for (int run = 0; run < 3000; ++run) {
    const Vector2d from(0.1 * uniform(random), 0.1 * uniform(random));
    const double angle = 6.28 * uniform(random);
    const Vector2d along(std::cos(angle), std::sin(angle));
    Slot slot;
    slot.open(from, 0);
    double end = 0;
    for (int k = 0; k < 6; ++k) {
      const double at = 0.01 * uniform(random);
      end = std::max(end, at);
      slot.include(from + at * along);
    }
    const double beyond = 0.01 * uniform(random);
    const Vector2d p = from + (end + beyond) * along;
    ASSERT_NEAR(slot.reach(p).distance_m, beyond, 1e-12) << run;
    ASSERT_NEAR(slot.reach(from + uniform(random) * end * along).distance_m, 0, 1e-12) << run;
    ASSERT_NEAR(slot.reach(p).distance_m, beyond, 1e-12) << run;
  }
}

// The walls' part of the potential against the sum over all Gauss points one by one.

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
