// SPDX-License-Identifier: Apache-2.0
#include "runtime/deformation/propagation.h"

#include <algorithm>

namespace trocar::runtime {

PropagationPlan plan_propagation(const Network& network, std::span<const NodeKind> kind,
                                 const PropagationOptions& options) {
  PropagationPlan plan;
  plan.options = options;
  plan.options.damping = std::clamp(options.damping, kMinDamping, 1.0);
  std::vector<std::uint8_t> reached(network.size(), 0);
  for (std::uint32_t i = 0; i < network.size(); ++i) {
    if (kind[i] != NodeKind::kTool) continue;
    plan.tool.push_back(i);
    reached[i] = 1;
  }
  std::vector<std::uint32_t> ring = plan.tool, next;
  for (int depth = 1; depth <= options.depth && !ring.empty(); ++depth) {
    next.clear();
    for (std::uint32_t i : ring) {
      for (std::uint32_t k = network.first[i]; k < network.first[i + 1]; ++k) {
        const std::uint32_t j = network.neighbour[k];
        if (reached[j] != 0 || kind[j] != NodeKind::kFree) continue;
        reached[j] = 1;
        next.push_back(j);
      }
    }
    plan.active.insert(plan.active.end(), next.begin(), next.end());
    ring.swap(next);
  }
  for (std::uint32_t i : plan.active) {
    double stiffness = network.foundation_N_per_m[i];
    for (std::uint32_t k = network.first[i]; k < network.first[i + 1]; ++k)
      stiffness += network.stiffness_N_per_m[k];
    plan.inverse_stiffness_m_per_N.push_back(1 / stiffness);
  }
  return plan;
}

PropagationState make_propagation_state(const Network& network, const PropagationPlan& plan) {
  return {std::vector<double>(network.size(), 0), std::vector<double>(plan.active.size(), 0)};
}

double propagate(const Network& network, const PropagationPlan& plan, double depth_m,
                 PropagationState& state) noexcept {
  for (std::uint32_t i : plan.tool)
    state.w_m[i] = depth_m;
  const double kept = 1 - plan.options.damping;
  for (int sweep = 0; sweep < plan.options.sweeps; ++sweep) {
    for (std::size_t a = 0; a < plan.active.size(); ++a) {
      const std::uint32_t i = plan.active[a];
      double& velocity = state.velocity_m_per_sweep[a];
      velocity =
          kept * velocity - reaction_N(network, state.w_m, i) * plan.inverse_stiffness_m_per_N[a];
      state.w_m[i] += velocity;
    }
  }
  double force_N = 0;
  for (std::uint32_t i : plan.tool)
    force_N += reaction_N(network, state.w_m, i);
  return force_N;
}

}  // namespace trocar::runtime
