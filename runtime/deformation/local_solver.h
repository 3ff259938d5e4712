// SPDX-License-Identifier: Apache-2.0
// The equilibrium of a network with the tool nodes held at the tool's depth and the ring nodes held
// at 0, and proven bounds on its distance from the equilibrium without the ring.
//
// Let w be the equilibrium of the whole network, v that of the region (0 on the ring), both for
// depth 1; F_w and F_v the forces on the tool; g_m the force that holds ring node m at 0, down
// positive: g_m = sum over the free neighbours j of k_mj v_j.
//
// Laws (tests/runtime/deformation/deformation_local_test.cpp):
//  1. F_w <= F_v: the ring is an additional support. F_w >= F_n, where F_n is the force with the
//     ring nodes free and everything beyond the ring left out. Both hold for springs of any sign:
//     omitting whole triangles omits energy that is never negative.
//  2. If no spring is negative: 0 <= w - v <= M everywhere, M = max of w on the ring (maximum
//     principle; beyond the ring v counts as 0). Let m be the ring node where w = M. Beyond the
//     ring w <= M, and inside it w <= v + M p, where p is the equilibrium with the ring at 1 and
//     the tool at 0. The balance of forces at m then gives
//       M <= B = max over m of g_m / (sum over free j of k_mj (1 - p_j) + sum over tool nodes of
//       k_mt + f_m).
//  3. By reciprocity F_v - F_w = sum over m of g_m w_m, so F_v - F_w <= B sum of g_m as well.
// Tests: tests/runtime/deformation/deformation_local_test.cpp
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "runtime/deformation/sparse_factor.h"

namespace trocar::runtime {

/// Bounds on the errors caused by the ring.
struct RingBounds {
  double force = 0;         ///< upper bound of (F_v - F_w) / F_v; in [0, 1]
  double displacement = 0;  ///< upper bound of max |w - v| / depth; in [0, 1]
  /// True if no spring of the region is negative: then `displacement` is proved, provided that none
  /// beyond the ring is negative either. If false, `displacement` is an estimate; `force` is still
  /// proved, by law 1.
  bool proved = true;
};

/// A region's equilibrium for depth 1.
struct LocalSolution {
  SparseFactor factor;
  std::vector<double> w;  ///< displacement of each node: 1 under the tool's rim, 0 on the ring
  double stiffness_N_per_m = 0;  ///< sum of the tool nodes' reactions
  RingBounds bounds;             ///< all 0 without ring nodes
};

struct LocalOptions {
  bool bounds = true;  ///< false: without bounds, which saves a solve
};

/// `kind` has network.size() elements. Returns false, and leaves `solution` unspecified, if the
/// matrix is not positive definite (sparse_factor.h). Allocates: not for the haptic thread.
bool solve_local(const Network& network, std::span<const NodeKind> kind, LocalSolution& solution,
                 const LocalOptions& options = {});

}  // namespace trocar::runtime
