// SPDX-License-Identifier: Apache-2.0
// The equilibrium of a whole network by Eigen's sparse Cholesky factorisation: the reference with
// which the other solvers are compared, and independent of local_solver's own factorisation.
#pragma once

#include <span>
#include <vector>

#include "formats/base/result.h"
#include "runtime/haptics/membrane/network.h"

namespace trocar::runtime {

struct GlobalSolution {
  std::vector<double> w;         ///< deflection of each node for the tool's depth 1
  double stiffness_N_per_m = 0;  ///< sum of the tool nodes' reactions
};

/// Tool nodes at 1, ring nodes (a whole slice has none) at 0. `kind` has network.size() elements.
/// Errors: an internal error if the matrix is not positive definite.
Result<GlobalSolution> solve_global(const Network& network, std::span<const NodeKind> kind);

}  // namespace trocar::runtime
