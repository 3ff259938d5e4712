// SPDX-License-Identifier: Apache-2.0
#include "runtime/deformation/local_solver.h"

#include <algorithm>

namespace trocar::runtime {
namespace {

/// Calls visit(neighbour, stiffness) for the springs of node i.
template <typename Visit>
void for_each_spring(const Network& network, std::size_t i, Visit&& visit) {
  for (std::uint32_t k = network.first[i]; k < network.first[i + 1]; ++k)
    visit(network.neighbour[k], network.stiffness_N_per_m[k]);
}

/// Returns the equilibrium with the held nodes of the kind `at_one` at 1 and all other held
/// nodes at 0.
std::vector<double> unit_shape(const Network& network, std::span<const NodeKind> kind,
                               const SparseFactor& factor, NodeKind at_one) {
  std::vector<double> w(network.size(), 0), x(factor.size(), 0);
  for (std::size_t u = 0; u < factor.size(); ++u) {
    for_each_spring(network, factor.nodes()[u], [&](std::uint32_t j, double stiffness) {
      if (kind[j] == at_one) x[u] += stiffness;
    });
  }
  factor.solve(x);
  for (std::size_t u = 0; u < factor.size(); ++u)
    w[factor.nodes()[u]] = x[u];
  for (std::size_t i = 0; i < network.size(); ++i) {
    if (kind[i] == at_one) w[i] = 1;
  }
  return w;
}

double tool_force(const Network& network, std::span<const NodeKind> kind,
                  std::span<const double> w) {
  double sum = 0;
  for (std::size_t i = 0; i < network.size(); ++i) {
    if (kind[i] == NodeKind::kTool) sum += reaction_N(network, w, i);
  }
  return sum;
}

/// Computes the bounds of laws 2 and 3.
RingBounds bounds_by_maximum_principle(const Network& network, std::span<const NodeKind> kind,
                                       const LocalSolution& solution) {
  const std::vector<double> p = unit_shape(network, kind, solution.factor, NodeKind::kBorder);
  double highest = 0, sum = 0;
  for (std::size_t m = 0; m < network.size(); ++m) {
    if (kind[m] != NodeKind::kBorder) continue;
    double g = 0, against = network.foundation_N_per_m[m];
    for_each_spring(network, m, [&](std::uint32_t j, double stiffness) {
      if (kind[j] == NodeKind::kBorder) return;
      g += stiffness * solution.w[j];
      against += stiffness * (1 - p[j]);
    });
    if (g > 0) highest = std::max(highest, g / against);
    sum += g;
  }
  return {std::min(1.0, highest * sum / solution.stiffness_N_per_m), std::min(1.0, highest), true};
}

/// Returns F_n of law 1, the force on the tool with the ring nodes free; -1 if there
/// is no solution.
double force_without_ring(const Network& network, std::span<const NodeKind> kind) {
  std::vector<NodeKind> released(kind.begin(), kind.end());
  std::replace(released.begin(), released.end(), NodeKind::kBorder, NodeKind::kFree);
  SparseFactor factor;
  if (!factor.make(network, released)) return -1;
  return tool_force(network, released, unit_shape(network, released, factor, NodeKind::kTool));
}

}  // namespace

bool solve_local(const Network& network, std::span<const NodeKind> kind, LocalSolution& solution,
                 const LocalOptions& options) {
  if (!solution.factor.make(network, kind)) return false;
  solution.w = unit_shape(network, kind, solution.factor, NodeKind::kTool);
  solution.stiffness_N_per_m = tool_force(network, kind, solution.w);
  solution.bounds = {};
  const bool has_ring = std::find(kind.begin(), kind.end(), NodeKind::kBorder) != kind.end();
  if (!options.bounds || !has_ring || !(solution.stiffness_N_per_m > 0)) return true;
  solution.bounds = bounds_by_maximum_principle(network, kind, solution);
  if (negative_at_free_nodes(network, kind) != 0) {
    solution.bounds.proved = false;
    const double least = force_without_ring(network, kind);
    solution.bounds.force = std::clamp(1 - least / solution.stiffness_N_per_m, 0.0, 1.0);
  }
  return true;
}

}  // namespace trocar::runtime
