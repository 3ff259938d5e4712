// SPDX-License-Identifier: Apache-2.0
// Computes the equilibrium of the spring network of a region, which is the part of a sheet around
// the tool. The tool nodes (NodeKind::kTool) are held at the tool's depth. The ring is the region's
// border to the rest of the sheet. Its nodes (NodeKind::kBorder) are held at 0, although they would
// move a little in the whole sheet. solve_local() also bounds the error that this causes.
//
// Let w be the equilibrium of the whole sheet's network and v the equilibrium of the region, both
// for tool depth 1. Let F_w and F_v be the forces on the tool in these two equilibria. Let g_m be
// the force of the springs on ring node m in the equilibrium v, positive in the direction in which
// the tool pushes:
//   g_m = sum of k_mj v_j over the neighbours j of m that are not on the ring.
//
// Laws (tests/runtime/deformation/deformation_local_test.cpp):
//  1. F_w <= F_v, because the ring is an additional support. F_w >= F_n, where F_n is the force on
//     the tool if the ring nodes are free and the sheet beyond the ring is omitted. Both
//     inequalities hold even if some springs have a negative stiffness, because the springs of a
//     triangle together never store a negative energy.
//  2. Let M be the maximum of w on the ring, and let v be 0 beyond the ring. If no spring has a
//     negative stiffness, then 0 <= w - v <= M everywhere (maximum principle, network.h). A bound B
//     on M follows from the balance of forces at the ring node where w = M. Beyond the ring, w is
//     at most M. Inside the ring, w is at most v + M p, where p is the equilibrium with the ring at
//     1 and the tool at 0. The balance of forces therefore gives M <= B with
//       B = max over the ring nodes m of g_m / (f_m + s_m),
//     where f_m is the stiffness of the foundation (the springs that hold each node at its rest
//     position, network.h) at m, and s_m is the sum of k_mj (1 - p_j) over the neighbours j of m
//     that are not on the ring.
//  3. By reciprocity (the network's matrix is symmetric), F_v - F_w = sum over the ring nodes m of
//     g_m w_m. So F_v - F_w is at most B times the sum of all g_m.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "runtime/deformation/sparse_factor.h"

namespace trocar::runtime {

/// Bounds on the errors that arise because the ring is held at 0, in the symbols of the laws above.
struct RingBounds {
  double force = 0;         ///< upper bound of (F_v - F_w) / F_v; in [0, 1]
  double displacement = 0;  ///< upper bound of max |w - v| / depth; in [0, 1]
  /// True if no spring at a free node of the region is negative. Both bounds are then proved,
  /// provided that no spring beyond the ring is negative either. If false, `displacement` is only
  /// an estimate, but `force` is proved all the same, because it then follows from law 1:
  /// (F_v - F_n) / F_v.
  bool proved = true;
};

/// Equilibrium of a region for tool depth 1.
struct LocalSolution {
  SparseFactor factor;
  /// Displacement of each node (v of the laws above): 1 at the tool nodes, 0 at the ring nodes.
  std::vector<double> w;
  double stiffness_N_per_m = 0;  ///< sum of the tool nodes' reactions
  /// Both bounds are 0 if there are no ring nodes, if LocalOptions::bounds is false, or if the
  /// stiffness is not positive.
  RingBounds bounds;
};

struct LocalOptions {
  bool bounds = true;  ///< if false, the bounds are not computed, which saves time
};

/// Solves a region. `kind`: kind of each node, network.size() elements. Returns true if the region
/// is solved. If the matrix is not positive definite (sparse_factor.h), returns false, and
/// `solution` is unspecified. The function allocates, so the haptic thread must not call it.
bool solve_local(const Network& network, std::span<const NodeKind> kind, LocalSolution& solution,
                 const LocalOptions& options = {});

}  // namespace trocar::runtime
