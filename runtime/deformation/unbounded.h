// SPDX-License-Identifier: Apache-2.0
// The stiffness of an unbounded sheet under a rigid tool of any outline, by boundary elements. It
// gives the T and f for which an undamaged sheet far from any edge has the stiffness K under a tool
// of any shape. For the network it is a reference solution on polygons that depends on no mesh.
//
// With w = 1 on the outline, G(r) = K0(r / lambda) / (2 pi) and n pointing into the sheet, the edge
// slope q = -dw/dn obeys Green's third identity
//   integral of G q ds = c(x) - integral of dG/dn_y ds for x on the outline (c = 1/2 off corners),
// solved by collocation with constant q on panels graded towards the corners, where q is singular
// (r^(pi/omega - 1), omega the angle outside the tool).
// Tests: tests/runtime/deformation/deformation_exact_test.cpp
#pragma once

#include <Eigen/Core>
#include <span>

#include "formats/base/result.h"
#include "runtime/deformation/network.h"

namespace trocar::runtime {

struct UnboundedOptions {
  int panels_per_side = 16;  ///< error of a hexagon's stiffness: below 3e-5
};

/// F / (w f) in m^2: the stiffness under a rigid tool for a foundation of 1 N/m^3. `outline_m`: a simple
/// polygon, counter-clockwise, of positive area; decay_length_m > 0. Refused: anything else, or a system
/// that cannot be solved. O((edges panels)^3): some ms for a hexagon.
Result<double> unbounded_stiffness_per_foundation_m2(std::span<const Eigen::Vector2d> outline_m,
                                                     double decay_length_m,
                                                     const UnboundedOptions& options = {});

/// The membrane of decay length lambda that has the stiffness K under the tool far from any edge.
Result<Membrane> membrane_for_tool(double stiffness_N_per_m, double decay_length_m,
                                   std::span<const Eigen::Vector2d> outline_m,
                                   const UnboundedOptions& options = {});

}  // namespace trocar::runtime
