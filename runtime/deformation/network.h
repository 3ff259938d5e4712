// SPDX-License-Identifier: Apache-2.0
// The spring network of a sheet (DESIGN, Force): one out-of-plane displacement w a node, energy
//   E(w) = 1/2 sum over springs k_ij (w_i - w_j)^2 + 1/2 sum over nodes f_i w_i^2,
// where k_ij = T (cot a + cot b) / 2 over the angles opposite to the edge ij (one of them on the
// boundary) and f_i = f A_i with A_i a third of the area of the triangles around i: linear finite
// elements of a membrane of tension T on a bed f, the bed lumped (Pinkall and Polthier 1993 for the
// cotangents; MacNeal 1949 for the network).
//
// Laws (tests/runtime/deformation/deformation_network_test.cpp tests each):
//  1. sum of f_i = f times the mesh's area.
//  2. The springs alone are the membrane's energy: 1/2 T times the integral of |grad w|^2 for the
//     w that is linear in each triangle. So they are positive semidefinite whatever the angles are,
//     and with the bed positive definite: a factorisation by Cholesky always exists.
//  3. An inner spring is non-negative iff its edge is locally Delaunay; a boundary one iff the
//     angle opposite to it is at most 90 degrees. Both signs are decided exactly, in integers.
//  4. If none is negative, an equilibrium without load takes its greatest and least value, if it
//     is positive and negative, in held nodes (maximum principle): the error bounds of
//     local_solver.h rest on that.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "formats/geometry/lattice.h"
#include "formats/geometry/slice_mesh.h"

namespace trocar::runtime {

/// The sheet's elastic constants; both positive.
struct Membrane {
  double tension_N_per_m = 0;
  double bed_N_per_m3 = 0;  ///< force per area and displacement
};
/// lambda = sqrt(T / f): how far the response reaches.
double reach_m(const Membrane& membrane) noexcept;

/// What holds a node.
enum class NodeKind : std::uint8_t {
  kFree,  ///< nothing: it is in equilibrium
  kTool,  ///< the tool, at the tool's depth
  kRing,  ///< the border of the region looked at, at 0
};

/// How many springs there are, and how many of them push where they should pull.
struct SpringSigns {
  std::uint32_t interior = 0, boundary = 0;
  std::uint32_t negative_interior = 0, negative_boundary = 0;
  std::uint32_t negative() const noexcept { return negative_interior + negative_boundary; }
};

/// Node i is vertex i of the mesh it was made from. Its springs stand in [first[i], first[i + 1]),
/// ascending by neighbour; each spring stands with both of its nodes.
struct Network {
  std::vector<std::uint32_t> first;  ///< nodes + 1 of them
  std::vector<std::uint32_t> neighbour;
  std::vector<double> stiffness_N_per_m;
  std::vector<double> bed_N_per_m;
  SpringSigns signs;

  std::size_t size() const noexcept { return bed_N_per_m.size(); }
};

/// `mesh` must be valid (formats/geometry/mesh_validity.h). O(n).
Network make_network(const SliceMesh& mesh, const Lattice& lattice, const Membrane& membrane);

/// How many springs of free nodes are negative: those that an equilibrium depends on. O(springs).
std::uint32_t negative_at_free_nodes(const Network& network,
                                     std::span<const NodeKind> kind) noexcept;

/// The force along w that must act on node i so that it stays at w: sum over j of
/// k_ij (w_i - w_j), plus f_i w_i. Zero in equilibrium; the reaction where the node is held.
double reaction_N(const Network& network, std::span<const double> w_m, std::size_t i) noexcept;

}  // namespace trocar::runtime
