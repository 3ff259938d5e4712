// SPDX-License-Identifier: Apache-2.0
// Force propagation (paper, II.C, after its reference [5]; Choi, Sun, Heng and Zou, "Deformable
// simulation using force propagation model with finite element optimization", Computers & Graphics
// 28, 2004): an optional solver, not the default.
//
// Fixed by the published descriptions: the object is a network of mass points and springs. A node
// that the tool moves passes force on to its neighbours, and so on, so that nodes are activated
// breadth first from the contact. The deformation is confined to a given depth in rings of nodes,
// so the cost depends on the depth and not on the object. The active nodes move by an explicit step
// with damping.
//
// Chosen here: springs and Winkler foundation are those of network.h, so that depth and time are the only sources
// of error against its equilibrium. The tool's nodes have depth 0; nodes deeper than the given
// depth do not move (w = 0). The step is the semi-implicit Euler step, node by node in the order of
// activation, so that within one sweep force runs outwards through all rings (positions of nodes
// activated earlier are already the new ones). Masses are scaled to each node's own stiffness, m_i
// = k_i dt^2 with k_i = sum of k_ij + f_i: every node has the same stability limit, and the
// transient is numerical, not physical. A step is then
//   v_i <- (1 - damping) v_i - r_i / k_i,   w_i <- w_i + v_i   (v in m per sweep)
// with r_i the reaction of network.h: a fixed point is the depth-limited equilibrium. With damping
// = 1 this is Gauss and Seidel's iteration.
// Tests: tests/runtime/deformation/deformation_propagation_test.cpp
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "runtime/deformation/network.h"

namespace trocar::runtime {

/// At 0.5 or less, the mode that alternates along the sweep grows (von Neumann's stability
/// analysis).
inline constexpr double kMinDamping = 0.55;

struct PropagationOptions {
  int depth = 6;   ///< rings of nodes around the tool that move; >= 1
  int sweeps = 4;  ///< in each tick; >= 1
  /// Part of its velocity that a node loses in a sweep; clamped to [kMinDamping, 1].
  double damping = 0.7;
};

/// The order of activation. Immutable once made.
struct PropagationPlan {
  std::vector<std::uint32_t> tool;                ///< depth 0
  std::vector<std::uint32_t> active;              ///< depth 1 .. options.depth, breadth first
  std::vector<double> inverse_stiffness_m_per_N;  ///< one value per active node
  PropagationOptions options;
};

/// The moving state; sized by make_propagation_state.
struct PropagationState {
  std::vector<double> w_m;                   ///< one value per node
  std::vector<double> velocity_m_per_sweep;  ///< one value per active node
};

/// `kind` has network.size() elements; ring nodes never move. Allocates.
PropagationPlan plan_propagation(const Network& network, std::span<const NodeKind> kind,
                                 const PropagationOptions& options);
PropagationState make_propagation_state(const Network& network, const PropagationPlan& plan);

/// One tick with the tool at `depth_m`: `options.sweeps` sweeps. Returns the sum of the tool nodes'
/// reactions in N, without the foundation under the tool. No allocation; O(springs of active nodes).
double propagate(const Network& network, const PropagationPlan& plan, double depth_m,
                 PropagationState& state) noexcept;

}  // namespace trocar::runtime
