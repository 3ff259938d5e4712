// SPDX-License-Identifier: Apache-2.0
// Force propagation (runtime/haptics/membrane/region.h) compared with the equilibrium.
#include "runtime/haptics/membrane/region.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "tests/reference/deformation/global_solver.h"
#include "tests/support/deformation_fixture.h"
#include "tests/support/sheet_fixture.h"
#include "tests/support/test_lattice.h"

namespace trocar::runtime {
namespace {

using trocar::test::kLattice;
using trocar::test::kMembrane;

struct Net {
  SliceMesh mesh = test::triangular_mesh({0, 0}, 256, 41);
  Network network;
  std::vector<NodeKind> kind;

  explicit Net(double shake = 0.15) {
    std::mt19937_64 random(3);
    for (LatticePoint& p : mesh.vertices) {
      p.x += static_cast<std::int32_t>(256 * shake * (2 * test::uniform(random) - 1));
      p.y += static_cast<std::int32_t>(256 * shake * (2 * test::uniform(random) - 1));
    }
    network = make_network(mesh, kLattice, kMembrane);
    kind.assign(network.size(), NodeKind::kFree);
    for (std::size_t i = 0; i < kind.size(); ++i) {
      if (std::hypot(mesh.vertices[i].x - 5000, mesh.vertices[i].y - 4400) < 700)
        kind[i] = NodeKind::kTool;
    }
  }
};

double settle(const Net& net, const PropagationPlan& plan, PropagationState& state, int ticks) {
  double force = 0;
  for (int tick = 0; tick < ticks; ++tick)
    force = propagate(net.network, plan, 1, state);
  return force;
}

TEST(Propagation, ActivatesBreadthFirstDownToItsDepth) {
  const Net net;
  std::vector<int> depth(net.network.size(), 1000);
  for (std::size_t i = 0; i < depth.size(); ++i) {
    if (net.kind[i] == NodeKind::kTool) depth[i] = 0;
  }
  for (int round = 0; round < 60; ++round) {
    for (std::size_t i = 0; i < depth.size(); ++i) {
      for (std::uint32_t k = net.network.first[i]; k < net.network.first[i + 1]; ++k)
        depth[i] = std::min(depth[i], depth[net.network.neighbour[k]] + 1);
    }
  }
  for (const int wanted : {1, 3, 8, 200}) {
    const PropagationPlan plan = plan_propagation(net.network, net.kind, {.depth = wanted});
    EXPECT_TRUE(
        std::is_sorted(plan.active.begin(), plan.active.end(),
                       [&](std::uint32_t a, std::uint32_t b) { return depth[a] < depth[b]; }));
    const auto expected =
        std::count_if(depth.begin(), depth.end(), [&](int d) { return d >= 1 && d <= wanted; });
    EXPECT_EQ(plan.active.size(), static_cast<std::size_t>(expected));
    EXPECT_EQ(std::set<std::uint32_t>(plan.active.begin(), plan.active.end()).size(),
              plan.active.size());
  }
}

// The state at rest is the equilibrium with all deeper nodes held at 0.
TEST(Propagation, SettlesAtTheDepthLimitedEquilibrium) {
  const Net net;
  for (const int depth : {1, 4, 9}) {
    for (const double damping : /* the first is taken as the least */ {0.1, 0.6, 0.7, 1.0}) {
      const PropagationPlan plan = plan_propagation(
          net.network, net.kind, {.depth = depth, .sweeps = 4, .damping = damping});
      std::vector<NodeKind> limited(net.kind.size(), NodeKind::kBorder);
      for (std::uint32_t i : plan.active)
        limited[i] = NodeKind::kFree;
      for (std::uint32_t i : plan.tool)
        limited[i] = NodeKind::kTool;
      LocalSolution expected;
      ASSERT_TRUE(solve_local(net.network, limited, expected));
      PropagationState state = make_propagation_state(net.network, plan);
      const double force = settle(net, plan, state, 400);
      EXPECT_NEAR(force / expected.stiffness_N_per_m, 1, 1e-9) << depth << ", " << damping;
      for (std::size_t i = 0; i < state.w_m.size(); ++i)
        EXPECT_NEAR(state.w_m[i], expected.w[i], 1e-9);
      // Linear: half as deep, half the force.
      for (int tick = 0; tick < 400; ++tick)
        propagate(net.network, plan, 0.5, state);
      EXPECT_NEAR(propagate(net.network, plan, 0.5, state) / force, 0.5, 1e-9);
    }
  }
}

TEST(Propagation, ErrorFallsWithTheDepth) {
  const Net net;
  const auto global = solve_global(net.network, net.kind);
  ASSERT_TRUE(global);
  double last = 1e9;
  for (int depth = 1; depth <= 12; ++depth) {
    const PropagationPlan plan = plan_propagation(net.network, net.kind, {.depth = depth});
    PropagationState state = make_propagation_state(net.network, plan);
    const double error = settle(net, plan, state, 300) / global->stiffness_N_per_m - 1;
    EXPECT_GT(error, -1e-9);
    EXPECT_LT(error, last);
    last = error;
  }
  EXPECT_LT(last, 0.1);
}

// One tick moves every ring, as nodes are updated in the order of activation.
TEST(Propagation, OneTickReachesTheWholeDepth) {
  const Net net;
  const PropagationPlan plan = plan_propagation(net.network, net.kind, {.depth = 7, .sweeps = 1});
  PropagationState state = make_propagation_state(net.network, plan);
  propagate(net.network, plan, 1e-3, state);
  for (std::uint32_t i : plan.active)
    EXPECT_GT(state.w_m[i], 0);
}

TEST(Propagation, WithoutAToolNothingMoves) {
  const Net net;
  const std::vector<NodeKind> free(net.kind.size(), NodeKind::kFree);
  const PropagationPlan plan = plan_propagation(net.network, free, {});
  EXPECT_TRUE(plan.active.empty());
  PropagationState state = make_propagation_state(net.network, plan);
  EXPECT_EQ(propagate(net.network, plan, 1, state), 0);
}

}  // namespace
}  // namespace trocar::runtime
