// SPDX-License-Identifier: Apache-2.0
#include "tests/reference/deformation/network_checks.h"

#include <cstddef>
#include <cstdint>

namespace trocar::runtime {

SpringSigns spring_signs(const SliceMesh& mesh) {
  return make_network(mesh, Lattice{}, Membrane{1, 1}).signs;
}

double energy_J(const Network& network, std::span<const double> w_m) noexcept {
  double twice = 0;
  for (std::size_t i = 0; i < network.size(); ++i) {
    twice += network.foundation_N_per_m[i] * w_m[i] * w_m[i];
    for (std::uint32_t k = network.first[i]; k < network.first[i + 1]; ++k) {
      const std::uint32_t j = network.neighbour[k];
      if (j > i) twice += network.stiffness_N_per_m[k] * (w_m[i] - w_m[j]) * (w_m[i] - w_m[j]);
    }
  }
  return twice / 2;
}

}  // namespace trocar::runtime
