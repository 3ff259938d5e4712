// SPDX-License-Identifier: Apache-2.0
// Computes the equilibrium of the spring network of a region, which is the part of a sheet around
// the tool. The tool nodes are held at the tool's depth. The ring nodes are held at 0; the ring is
// the region's border to the rest of the sheet. Also computes proven bounds on the difference from
// the equilibrium of the whole sheet's network.
//
// Let w be the equilibrium of the whole network and v that of the region (v = 0 on the ring),
// both for depth 1. Let F_w and F_v be the corresponding forces on the tool. Let g_m be the
// force, positive downwards, that holds ring node m at 0: g_m = sum of k_mj v_j over the
// neighbours j of m that are not on the ring.
//
// Laws (tests/runtime/deformation/deformation_local_test.cpp):
//  1. F_w <= F_v, because the ring is an additional support. F_w >= F_n, where F_n is the force
//     with the ring nodes free and everything beyond the ring omitted. Both hold for springs of any
//     sign, because omitting whole triangles omits energy that is never negative.
//  2. Let M be the maximum of w on the ring, and let v be 0 beyond the ring. If no spring is
//     negative, then 0 <= w - v <= M everywhere (maximum principle). Let m be the ring node at
//     which w = M. Beyond the ring w <= M. Inside the ring w <= v + M p, where p is the equilibrium
//     with the ring at 1 and the tool at 0. The balance of forces at m then gives M <= B with
//       B = max over the ring nodes m of g_m / (f_m + s_m),
//     where s_m is the sum of k_mj (1 - p_j) over the neighbours j of m that are not on the ring.
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
  /// True if no spring at a free node of the region is negative. Then both bounds are proved,
  /// provided that no spring beyond the ring is negative either. If false, `displacement` is an
  /// estimate, and `force` is proved by law 1.
  bool proved = true;
};

/// Equilibrium of a region for depth 1.
struct LocalSolution {
  SparseFactor factor;
  std::vector<double> w;  ///< displacement of each node: 1 at the tool nodes, 0 at the ring nodes
  double stiffness_N_per_m = 0;  ///< sum of the tool nodes' reactions
  /// Both bounds are 0 if there are no ring nodes, or if LocalOptions::bounds is false.
  RingBounds bounds;
};

struct LocalOptions {
  bool bounds = true;  ///< false: the bounds are not computed, which saves one solve
};

/// Solves a region. `kind` has network.size() elements. If the matrix is not positive definite
/// (sparse_factor.h), returns false and leaves `solution` unspecified. The function allocates, so
/// the haptic thread must not call it.
bool solve_local(const Network& network, std::span<const NodeKind> kind, LocalSolution& solution,
                 const LocalOptions& options = {});

}  // namespace trocar::runtime
