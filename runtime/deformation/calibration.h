// SPDX-License-Identifier: Apache-2.0
// Finds the membrane tension T and the foundation stiffness f for which an undamaged sheet far from any edge has
// the stiffness K under the tool.
//
// Finite elements of a given size are stiffer than the continuum. Under a tool the excess arises mostly along the
// tool's outline and at its corners, and is nearly the same at every position: 4 to 5 % with the default grading,
// with a spread of 0.3 % (tests/runtime/deformation/deformation_accuracy_test.cpp). The error is in the springs,
// not in the Winkler foundation: under a tool that covers the whole sheet, the stiffness is exactly f times the
// area. So f is taken from the exact solution of the continuum. T is lowered until the mean stiffness of meshes
// of the same grading, in an unbounded sheet, equals K. T then falls by 5 to 8 %, which shortens the decay length
// lambda by 2 to 4 % (if lambda is at least 1.5 circumradii of the tool).
// Tests: tests/runtime/deformation/deformation_accuracy_test.cpp
#pragma once

#include "formats/base/result.h"
#include "runtime/deformation/region.h"

namespace trocar::runtime {

struct Calibration {
  Membrane membrane;  ///< calibrated
  double excess = 0;  ///< without calibration: mean of K_mesh / K_exact - 1
  double spread = 0;  ///< largest relative deviation from the mean over the sampled positions
  double exact_foundation_N_per_m3 = 0;  ///< f of the exact solution (unbounded.h)
};

/// `tool`: outline of the upright tool on the lattice, at any position. If grading.graded is false, the mesh is
/// that of the slice, whose grading is unknown, so the constants of the exact solution are returned. Errors:
/// (refused) a stiffness or decay length that is not positive, a decay length of more than 2^26 steps, an outline
/// that is not a simple polygon. Takes about 30 ms: twelve regions are meshed, and each is solved seven times.
Result<Calibration> calibrate(double stiffness_N_per_m, double decay_length_m, const Ring& tool,
                              const Lattice& lattice, const Grading& grading = {});

}  // namespace trocar::runtime
