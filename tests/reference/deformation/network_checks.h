// SPDX-License-Identifier: Apache-2.0
// Properties of a spring network that only tests look at.
#pragma once

#include <span>

#include "formats/mesh/slice_mesh.h"
#include "runtime/haptics/membrane/network.h"

namespace trocar::runtime {

/// How many springs a valid mesh has, and how many of them are negative, for any membrane. O(n).
SpringSigns spring_signs(const SliceMesh& mesh);

/// The energy E(w) of network.h in J; w has network.size() elements, in m. O(springs).
double energy_J(const Network& network, std::span<const double> w_m) noexcept;

}  // namespace trocar::runtime
