// SPDX-License-Identifier: Apache-2.0
// Computes the shape of a sheet and the force on the tool by force propagation. A scene can choose
// this approximate method instead of the default solver.
// Sources: the paper (II.C, which follows its reference [5]); Choi, Sun, Heng and Zou,
// "Deformable simulation using force propagation model with finite element optimization",
// Computers & Graphics 28, 2004.
//
// The published descriptions agree on the following. The object is a network of mass points and
// springs. A node that the tool moves passes force on to its neighbours, and each neighbour passes
// force on to its own neighbours. Nodes are thus activated breadth first from the contact. The
// depth of a node is the smallest number of springs between the node and the contact. Only nodes up
// to a given depth move, so the cost depends on this depth and not on the size of the object. The
// active nodes move by an explicit step with damping.
//
// The published descriptions leave the following open. It is chosen here:
//  - Springs and Winkler foundation are those of network.h. So the result differs from the
//    network's equilibrium only because the depth and the number of steps are limited.
//  - The tool's nodes have depth 0. Nodes deeper than the given depth do not move (w = 0).
//  - The step is the semi-implicit Euler step, which moves a node with its new velocity. A
//    sweep applies the step to the active nodes in the order of activation, and uses the new
//    positions of nodes activated earlier. In one sweep the force therefore travels outwards
//    through all active nodes.
//  - Let k_ij be the stiffness of the spring between the nodes i and j, and f_i the stiffness of
//    the Winkler foundation at node i (network.h). The stiffness at node i is then
//    k_i = f_i + sum of k_ij over j. The mass of node i is m_i = k_i dt^2, where dt is the duration
//    of a sweep. With this mass every node has the same stability limit.
//    The motion before the equilibrium is numerical: it does not show how tissue would move.
// With these choices the step of node i is
//   v_i <- (1 - damping) v_i - r_i / k_i,   w_i <- w_i + v_i   (v in m per sweep)
// where r_i is reaction_N() of network.h. A fixed point of this step is the equilibrium with
// limited depth. With damping = 1 the step is the Gauss-Seidel iteration.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "runtime/deformation/network.h"

namespace trocar::runtime {

/// Smallest damping: plan_propagation() raises a smaller one to this value. A damping of less than
/// 0.5 can be unstable. In a long chain of equal springs without foundation, for example, all nodes
/// can move together, and their velocity is then multiplied by 2 (1 - damping) in each sweep (von
/// Neumann's stability analysis).
inline constexpr double kMinDamping = 0.55;

struct PropagationOptions {
  int depth = 6;   ///< largest depth of a node that moves; >= 1
  int sweeps = 4;  ///< number of sweeps per call of propagate(); >= 1
  /// Fraction of its velocity that a node loses in a sweep; clamped to [kMinDamping, 1].
  double damping = 0.7;
};

/// The nodes that move, in the order of activation. All calls of propagate() use the same plan.
struct PropagationPlan {
  std::vector<std::uint32_t> tool;                ///< nodes of depth 0
  std::vector<std::uint32_t> active;              ///< nodes of depth 1 .. options.depth
  std::vector<double> inverse_stiffness_m_per_N;  ///< 1 / k_i of each active node
  PropagationOptions options;
};

/// State that changes with each call of propagate(). make_propagation_state() makes it.
struct PropagationState {
  std::vector<double> w_m;                   ///< displacement of each node of the network
  std::vector<double> velocity_m_per_sweep;  ///< one value per active node
};

/// Makes the plan. `kind`: kind of each node, network.size() elements. Nodes of the kind kBorder
/// never move. Allocates.
PropagationPlan plan_propagation(const Network& network, std::span<const NodeKind> kind,
                                 const PropagationOptions& options);
/// Makes a state in which nothing is deformed. Allocates.
PropagationState make_propagation_state(const Network& network, const PropagationPlan& plan);

/// Runs plan.options.sweeps sweeps. The tool's nodes are held at the displacement `depth_m` (here a
/// length in m, not a number of springs). Returns the sum of the tool nodes' reactions in N. This
/// sum does not contain the force of the foundation under the tool, which the caller has to add.
/// Does not allocate. O(springs of active nodes) per sweep.
double propagate(const Network& network, const PropagationPlan& plan, double depth_m,
                 PropagationState& state) noexcept;

}  // namespace trocar::runtime
