// SPDX-License-Identifier: Apache-2.0
// The equilibrium of a network whose tool nodes are held at the tool's depth and whose ring nodes
// are held at 0, with proven bounds on how far that is from the equilibrium without the ring.
//
// Let w be the equilibrium of the whole network, v that of the region (0 on the ring), both for
// depth 1; F_w and F_v the tool's forces; g_m the force that holds ring node m at 0, down positive:
// g_m = sum over the free neighbours j of k_mj v_j. Then
// (tests/runtime/deformation/deformation_local_test.cpp):
//  1. F_w <= F_v: the ring is an additional support. F_w >= F_n, where F_n is the force with the
//     ring let go and everything beyond it left out. Both hold whatever the springs' signs: leaving
//     out whole triangles leaves out energy that is never negative.
//  2. If no spring is negative: 0 <= w - v <= M everywhere, M = max of w on the ring (maximum
//     principle; beyond the ring v counts as 0). In the ring's highest node m all that lies beyond
//     is at most M, and within w <= v + M p, where p is the equilibrium with the ring at 1 and the
//     tool at 0; the balance of m then gives
//       M <= B = max over m of g_m / (sum over free j of k_mj (1 - p_j) + sum over tool nodes of
//       k_mt + f_m).
//  3. By reciprocity F_v - F_w = sum over m of g_m w_m, so F_v - F_w <= B sum of g_m as well.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "runtime/deformation/sparse_factor.h"

namespace trocar::runtime {

/// Bounds on the errors that the ring makes.
struct RingBounds {
  double force = 0;         ///< (F_v - F_w) / F_v, at most this; in [0, 1]
  double displacement = 0;  ///< max of |w - v| over the depth, at most this; in [0, 1]
  /// No spring of the region is negative, so `displacement` is proved, given that none beyond the
  /// ring is. If false it is an estimate (`force` is proved all the same, by law 1).
  bool proved = true;
};

/// A region's equilibrium for the depth 1.
struct LocalSolution {
  SparseFactor factor;
  std::vector<double> w;         ///< of each node: 1 under the tool's rim, 0 on the ring
  double stiffness_N_per_m = 0;  ///< sum of the tool nodes' reactions
  RingBounds bounds;             ///< all 0 without ring nodes
};

struct LocalOptions {
  bool bounds = true;  ///< false: leave out the bounds, which need one more solve
};

/// `kind` has network.size() elements. Returns false, and leaves `solution` unspecified, if the
/// matrix is not positive definite (sparse_factor.h). Allocates; a worker's work.
bool solve_local(const Network& network, std::span<const NodeKind> kind, LocalSolution& solution,
                 const LocalOptions& options = {});

}  // namespace trocar::runtime
