// SPDX-License-Identifier: Apache-2.0
// The spring network of a sheet, and the stiffness of an unbounded one.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "formats/base/result.h"
#include "formats/mesh/lattice.h"
#include "formats/mesh/slice_mesh.h"

namespace trocar::runtime {

// The spring network of a sheet. Each node i has one displacement w_i, perpendicular to the sheet.
// The network has the energy
//   E(w) = 1/2 sum over springs k_ij (w_i - w_j)^2 + 1/2 sum over nodes f_i w_i^2.
// Here k_ij = T (cot a + cot b) / 2 is the stiffness of the spring between the nodes i and j, where
// T is the membrane tension, and a and b are the angles opposite to the edge ij. A boundary edge
// has only one opposite angle, and k_ij = T (cot a) / 2. Further, f_i = f A_i is the stiffness of
// the Winkler foundation at node i, where f is the foundation's stiffness per area, and A_i is a
// third of the area of the triangles around i. The network is the linear finite element model of a
// membrane on a Winkler foundation that acts only at the nodes. Sources: Pinkall and Polthier 1993
// for the cotangents, MacNeal 1949 for the network.
//
// Laws:
//  1. The sum of all f_i is f times the mesh's area.
//  2. The energy of the springs equals the energy of the membrane, which is T / 2 times the
//     integral of the squared gradient of w, where w is linear in each triangle. The matrix of the
//     springs is therefore positive semidefinite, whatever the angles. The sum of this matrix and
//     the foundation's matrix is positive definite, so a Cholesky factorisation always exists.
//  3. The spring of an inner edge has a non-negative stiffness if and only if the edge is locally
//     Delaunay, which means that the two angles opposite to the edge add up to at most 180
//     degrees. The spring of a boundary edge has a non-negative stiffness if and only if the
//     angle opposite to the edge is at most 90 degrees. make_network() decides these signs
//     exactly, in integers (SpringSigns).
//  4. Maximum principle: consider an equilibrium without load, in a network in which no
//     spring has a negative stiffness. A positive maximum and a negative minimum of w can
//     then occur only at nodes that are held (NodeKind). The error bounds of region.h
//     follow from this principle.

/// Elastic constants of a sheet. Both are positive.
struct Membrane {
  double tension_N_per_m = 0;
  double foundation_N_per_m3 = 0;  ///< force per area and displacement
};
/// Returns lambda = sqrt(T / f), the length over which a displacement decays.
double decay_length_m(const Membrane& membrane) noexcept;

/// Says how a node is held.
enum class NodeKind : std::uint8_t {
  kFree,  ///< not held; moves until the forces are in equilibrium
  kTool,  ///< held by the tool, at the tool's depth
  /// A node of the ring, held at 0. The ring is the border between a region (the part of a sheet
  /// around the tool, region.h) and the rest of the sheet.
  kBorder,
};

/// Number of springs at inner edges and at boundary edges, and how many of them have
/// a negative stiffness.
struct SpringSigns {
  std::uint32_t interior = 0, boundary = 0;
  std::uint32_t negative_interior = 0, negative_boundary = 0;
  std::uint32_t negative() const noexcept { return negative_interior + negative_boundary; }
};

/// A spring network. Node i is vertex i of the mesh. The springs of node i have the indices from
/// first[i] to first[i + 1] - 1, in ascending order of their other nodes. Each spring is listed at
/// both of its nodes.
struct Network {
  std::vector<std::uint32_t> first;        ///< size() + 1 elements
  std::vector<std::uint32_t> neighbour;    ///< other node of each listed spring
  std::vector<double> stiffness_N_per_m;   ///< k_ij of each listed spring
  std::vector<double> foundation_N_per_m;  ///< f_i of each node
  SpringSigns signs;

  std::size_t size() const noexcept { return foundation_N_per_m.size(); }
};

/// Makes the network of a mesh. Precondition: the mesh is valid
/// (formats/mesh/mesh_validity.h). O(vertices).
Network make_network(const SliceMesh& mesh, const Lattice& lattice, const Membrane& membrane);

/// Returns the number of springs with a negative stiffness and at least one free node. Only these
/// negative springs matter, because a spring between two held nodes does not affect the equilibrium
/// of the free nodes. `kind`: kind of each node. O(springs).
std::uint32_t negative_at_free_nodes(const Network& network,
                                     std::span<const NodeKind> kind) noexcept;

/// Returns the force in the direction of w that keeps node i in place:
///   f_i w_i + sum over neighbours j of k_ij (w_i - w_j).
/// At a free node in equilibrium, the force is zero. At a held node, the force is the reaction.
double reaction_N(const Network& network, std::span<const double> w_m, std::size_t i) noexcept;

// Computes the stiffness of an unbounded sheet under a rigid tool with any outline. The method is
// that of boundary elements, whose unknowns lie only on the tool's outline. The sheet is a membrane
// with the tension T on a Winkler foundation with the stiffness f per area. The sheet's deflection
// u satisfies T laplacian(u) = f u, so u decays over the length lambda = sqrt(T / f).
// membrane_for_tool() computes T and f from lambda and from the stiffness that the tool is to feel
// on a sheet without holes, far from any edge. No mesh is used, so the stiffness also serves as a
// reference for the spring network.
//
// Let u = 1 on the tool's outline. Let n be the normal that points into the sheet, and q = -du/dn
// the slope at the outline. Let r be the distance between two points x and y, and
//   G(r) = K0(r / lambda) / (2 pi),
// where K0 is the modified Bessel function of the second kind. Green's third identity gives
//   integral of G q ds = c(x) - integral of dG/dn_y ds
// for x on the outline. The integrals run over the points y of the outline, ds is an element of
// its length, and c = 1/2 except at corners. The outline's edges are divided into panels. The
// slope q is taken as constant on each panel, and the equation is solved for x at the middle of
// each panel (collocation). At a corner, q is singular as d^(pi/omega - 1), where d is the
// distance from the corner and omega is the angle outside the tool. The panels therefore get
// shorter towards the corners.

/// Default number of panels per edge. With 16, the relative error of a hexagon's stiffness is 3e-5.
inline constexpr int kPanelsPerSide = 16;

/// Returns F / (d f) in m^2, where F is the force on a rigid tool at the depth d, and f is the
/// stiffness of the foundation. This is the stiffness under the tool, per unit of f. `outline_m`: a
/// simple counter-clockwise polygon of positive area. `decay_length_m`: positive. Errors: kRefused
/// if an argument is not as described, or if the equations cannot be solved. O((edges *
/// panels_per_side)^3); takes some milliseconds for a hexagon.
Result<double> unbounded_stiffness_per_foundation_m2(std::span<const Eigen::Vector2d> outline_m,
                                                     double decay_length_m,
                                                     int panels_per_side = kPanelsPerSide);

/// Returns the membrane with this decay length whose stiffness under the tool, far from any
/// edge, is `stiffness_N_per_m`. Errors: those of unbounded_stiffness_per_foundation_m2().
Result<Membrane> membrane_for_tool(double stiffness_N_per_m, double decay_length_m,
                                   std::span<const Eigen::Vector2d> outline_m,
                                   int panels_per_side = kPanelsPerSide);

}  // namespace trocar::runtime
