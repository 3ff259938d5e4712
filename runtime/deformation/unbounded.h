// SPDX-License-Identifier: Apache-2.0
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
#pragma once

#include <Eigen/Core>
#include <span>

#include "formats/base/result.h"
#include "runtime/deformation/network.h"

namespace trocar::runtime {

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
