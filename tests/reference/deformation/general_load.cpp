// SPDX-License-Identifier: Apache-2.0
#include "tests/reference/deformation/general_load.h"

#include <cstddef>
#include <cstdint>

namespace trocar::runtime {

void solve_general(const Network& network, std::span<const NodeKind> kind,
                   const SparseFactor& factor, std::span<const double> held_m,
                   std::span<const double> force_N, std::span<double> work,
                   std::span<double> w_m) noexcept {
  for (std::size_t u = 0; u < factor.size(); ++u) {
    const std::uint32_t i = factor.nodes()[u];
    double right = force_N[i];
    for (std::uint32_t k = network.first[i]; k < network.first[i + 1]; ++k) {
      const std::uint32_t j = network.neighbour[k];
      if (kind[j] != NodeKind::kFree) right += network.stiffness_N_per_m[k] * held_m[j];
    }
    work[u] = right;
  }
  factor.solve(work.first(factor.size()));
  for (std::size_t i = 0; i < network.size(); ++i)
    w_m[i] = held_m[i];
  for (std::size_t u = 0; u < factor.size(); ++u)
    w_m[factor.nodes()[u]] = work[u];
}

}  // namespace trocar::runtime
