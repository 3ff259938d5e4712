// SPDX-License-Identifier: Apache-2.0
// A network's equilibrium under arbitrary loads, with a given factor. The programs need only one
// load, a tool at depth 1, and scale its solution.
#pragma once

#include <span>

#include "runtime/haptics/membrane/network.h"
#include "runtime/haptics/membrane/region.h"

namespace trocar::runtime {

/// `held_m`: the displacements of the held nodes (those of free nodes are ignored); `force_N`: the
/// forces on the free nodes (those on held ones are ignored); `w_m` receives all displacements.
/// Each has network.size() elements; `work` has factor.size(). No allocation; O(springs of free
/// nodes + factor.entries()).
void solve_general(const Network& network, std::span<const NodeKind> kind,
                   const SparseFactor& factor, std::span<const double> held_m,
                   std::span<const double> force_N, std::span<double> work,
                   std::span<double> w_m) noexcept;

}  // namespace trocar::runtime
