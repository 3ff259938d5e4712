// SPDX-License-Identifier: Apache-2.0
// The stiffness of an unbounded sheet under a rigid tool with any outline, computed by boundary
// elements. The sheet is a membrane with the tension T on an elastic foundation with the stiffness f
// per area. Its deflection u satisfies T laplacian(u) = f u, so it decays over the length
// lambda = sqrt(T / f). membrane_for_tool() computes T and f from lambda and from the stiffness that
// the tool is to feel on an undamaged sheet far from any edge. The result also serves as a reference
// for the spring network, because it does not depend on a mesh.
//
// Let u = 1 on the tool's outline, n the normal pointing into the sheet, q = -du/dn the slope at
// the outline, and G(r) = K0(r / lambda) / (2 pi), where K0 is the modified Bessel function of the
// second kind. Green's third identity gives
//   integral of G q ds = c(x) - integral of dG/dn_y ds
// for x on the outline, with c = 1/2 except at corners. The equation is solved by collocation with
// constant q on panels, which are parts of the outline's edges. The panels get shorter towards the
// corners, where q is singular as r^(pi/omega - 1). Here r is the distance from the corner, and
// omega is the angle outside the tool.
// Tests: tests/runtime/deformation/deformation_exact_test.cpp
#pragma once

#include <Eigen/Core>
#include <span>

#include "formats/base/result.h"
#include "runtime/deformation/network.h"

namespace trocar::runtime {

struct UnboundedOptions {
  int panels_per_side = 16;  ///< 16: the relative error of a hexagon's stiffness is below 3e-5
};

/// Returns F / (d f) in m^2, with the force F on the tool and its depth d. This is the stiffness
/// under a rigid tool for a foundation of 1 N/m^3. `outline_m`: a simple counter-clockwise polygon
/// of positive area. `decay_length_m`: positive. Errors: kRefused if an argument is not as
/// described, or if the equations cannot be solved. O((edges * panels)^3); takes some milliseconds
/// for a hexagon.
Result<double> unbounded_stiffness_per_foundation_m2(std::span<const Eigen::Vector2d> outline_m,
                                                     double decay_length_m,
                                                     const UnboundedOptions& options = {});

/// Returns the membrane with this decay length whose stiffness under the tool, far from any
/// edge, is `stiffness_N_per_m`. Errors: those of unbounded_stiffness_per_foundation_m2().
Result<Membrane> membrane_for_tool(double stiffness_N_per_m, double decay_length_m,
                                   std::span<const Eigen::Vector2d> outline_m,
                                   const UnboundedOptions& options = {});

}  // namespace trocar::runtime
