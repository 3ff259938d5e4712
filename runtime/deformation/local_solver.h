// SPDX-License-Identifier: Apache-2.0
// Computes the equilibrium of a region's network, with the tool nodes held at the tool's depth and
// the ring nodes (the region's border to the rest of the sheet) held at 0. Also computes proven
// bounds on the difference from the equilibrium of the whole sheet's network.
//
// Let w be the equilibrium of the whole network and v that of the region (v = 0 on the ring),
// both for depth 1. Let F_w and F_v be the corresponding forces on the tool. Let g_m be the
// force, positive downwards, that holds ring node m at 0: g_m = sum over the free neighbours
// j of k_mj v_j.
//
// Laws (tests/runtime/deformation/deformation_local_test.cpp):
//  1. F_w <= F_v, because the ring is an additional support. F_w >= F_n, where F_n is the force
//     with the ring nodes free and everything beyond the ring omitted. Both hold for springs of any
//     sign, because omitting whole triangles omits energy that is never negative.
//  2. Let M be the maximum of w on the ring, and let v be 0 beyond the ring. If no spring is
//     negative, then 0 <= w - v <= M everywhere (maximum principle). Let m be the ring node at
//     which w = M. Beyond the ring w <= M. Inside the ring w <= v + M p, where p is the equilibrium
//     with the ring at 1 and the tool at 0. The balance of forces at m then gives
//       M <= B = max over m of g_m / (sum over free j of k_mj (1 - p_j) + sum over tool nodes t of
//       k_mt + f_m).
//  3. By reciprocity F_v - F_w = sum over m of g_m w_m, so F_v - F_w <= B times the sum of all g_m.
// Tests: tests/runtime/deformation/deformation_local_test.cpp
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "runtime/deformation/sparse_factor.h"

namespace trocar::runtime {

/// Bounds on the errors that the ring causes.
struct RingBounds {
  double force = 0;         ///< upper bound of (F_v - F_w) / F_v; in [0, 1]
  double displacement = 0;  ///< upper bound of max |w - v| / depth; in [0, 1]
  /// True if no spring of the region is negative. Then both bounds are proved, provided that no
  /// spring beyond the ring is negative either. If false, `displacement` is an estimate, and
  /// `force` is proved by law 1.
  bool proved = true;
};

/// Equilibrium of a region for depth 1.
struct LocalSolution {
  SparseFactor factor;
  std::vector<double> w;  ///< displacement of each node: 1 under the tool's rim, 0 on the ring
  double stiffness_N_per_m = 0;  ///< sum of the tool nodes' reactions
  RingBounds bounds;             ///< all 0 if there are no ring nodes
};

struct LocalOptions {
  bool bounds = true;  ///< false: bounds are not computed, which saves a solve
};

/// Solves a region. `kind` has network.size() elements. If the matrix is not positive definite
/// (sparse_factor.h), returns false and leaves `solution` unspecified. It allocates, so it is not
/// for the haptic thread.
bool solve_local(const Network& network, std::span<const NodeKind> kind, LocalSolution& solution,
                 const LocalOptions& options = {});

}  // namespace trocar::runtime
