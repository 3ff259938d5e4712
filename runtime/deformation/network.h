// SPDX-License-Identifier: Apache-2.0
// The spring network of a sheet: one out-of-plane displacement w per node, with the energy
//   E(w) = 1/2 sum over springs k_ij (w_i - w_j)^2 + 1/2 sum over nodes f_i w_i^2,
// where k_ij = T (cot a + cot b) / 2 over the angles opposite to the edge ij (one of them on the
// boundary) and f_i = f A_i with A_i a third of the area of the triangles around i. These are
// linear finite elements of a membrane of tension T on a Winkler foundation f, lumped at the nodes (Pinkall and
// Polthier 1993 for the cotangents; MacNeal 1949 for the network).
//
// Laws (tests/runtime/deformation/deformation_network_test.cpp tests each):
//  1. sum of f_i = f times the mesh's area.
//  2. The springs' energy is the membrane's: 1/2 T times the integral of |grad w|^2 for the w that
//     is linear in each triangle. So it is positive semidefinite for any angles, and positive
//     definite together with the foundation: a Cholesky factorisation always exists.
//  3. An inner spring is non-negative iff its edge is locally Delaunay; a boundary one iff the
//     angle opposite to it is at most 90 degrees. Both signs are decided exactly, in integers.
//  4. Maximum principle: if no spring is negative, an equilibrium without load has its largest
//     value, if positive, and its smallest, if negative, at held nodes. The error bounds of
//     local_solver.h follow from this.
// Tests: tests/runtime/deformation/deformation_network_test.cpp
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
  double foundation_N_per_m3 = 0;  ///< force per area and displacement
};
/// lambda = sqrt(T / f): the length over which the response decays.
double decay_length_m(const Membrane& membrane) noexcept;

/// How a node is held.
enum class NodeKind : std::uint8_t {
  kFree,  ///< not held: in equilibrium
  kTool,  ///< held by the tool, at its depth
  kRing,  ///< on the region's border, held at 0
};

/// The number of springs, and of those with negative stiffness.
struct SpringSigns {
  std::uint32_t interior = 0, boundary = 0;
  std::uint32_t negative_interior = 0, negative_boundary = 0;
  std::uint32_t negative() const noexcept { return negative_interior + negative_boundary; }
};

/// Node i is vertex i of the mesh. Its springs are [first[i], first[i + 1]), ascending by
/// neighbour; each spring is listed at both of its nodes.
struct Network {
  std::vector<std::uint32_t> first;  ///< size() + 1 elements
  std::vector<std::uint32_t> neighbour;
  std::vector<double> stiffness_N_per_m;
  std::vector<double> bed_N_per_m;
  SpringSigns signs;

  std::size_t size() const noexcept { return bed_N_per_m.size(); }
};

/// `mesh` must be valid (formats/geometry/mesh_validity.h). O(n).
Network make_network(const SliceMesh& mesh, const Lattice& lattice, const Membrane& membrane);

/// The number of negative springs with a free node; the others do not affect an equilibrium.
/// O(springs).
std::uint32_t negative_at_free_nodes(const Network& network,
                                     std::span<const NodeKind> kind) noexcept;

/// The force along w that keeps node i in place: sum over j of k_ij (w_i - w_j), plus f_i w_i. Zero
/// at a free node in equilibrium; the reaction at a held node.
double reaction_N(const Network& network, std::span<const double> w_m, std::size_t i) noexcept;

}  // namespace trocar::runtime
