// SPDX-License-Identifier: Apache-2.0
// The noexcept functions of runtime/haptics/membrane do not allocate: a solve, a tick of propagation.
#include <gtest/gtest.h>

#include <vector>

#include "runtime/haptics/membrane/region.h"
#include "runtime/realtime/realtime_thread.h"
#include "tests/reference/deformation/general_load.h"
#include "tests/support/counted_allocations.h"
#include "tests/support/deformation_fixture.h"

namespace trocar::runtime {
namespace {

TEST(DeformationSolve, DoesNotAllocate) {
  TROCAR_NEEDS_COUNTED_ALLOCATIONS();
  const Network network =
      make_network(test::triangular_mesh({0, 0}, 256, 20), Lattice{8}, {320, 5e6});
  std::vector<NodeKind> kind(network.size(), NodeKind::kFree);
  kind[190] = kind[191] = NodeKind::kTool;
  kind[0] = NodeKind::kBorder;
  LocalSolution solution;
  ASSERT_TRUE(solve_local(network, kind, solution));
  std::vector<double> x(solution.factor.size(), 1), held(network.size(), 1e-3),
      force(network.size(), 0), w(network.size());
  const PropagationPlan plan = plan_propagation(network, kind, {});
  PropagationState state = make_propagation_state(network, plan);
  const std::uint64_t before = allocations_in_scopes();
  {
    const NoAllocationScope scope;
    solution.factor.solve(x);
    solve_general(network, kind, solution.factor, held, force, x, w);
    propagate(network, plan, 1e-3, state);
  }
  EXPECT_EQ(allocations_in_scopes() - before, 0U);
  EXPECT_GT(w[180], 0);
}

}  // namespace
}  // namespace trocar::runtime
