// SPDX-License-Identifier: Apache-2.0
// Finds the membrane tension T and the foundation stiffness f for which an undamaged sheet far from any edge has
// the stiffness K under the tool.
//
// Finite elements of a given size are stiffer than the continuum. Under a tool the excess of
// stiffness arises mostly along the tool's outline and at its corners. The excess is nearly the
// same at every position of the tool: 4 to 5 % with the default grading, with a spread of 0.3 %
// (tests/runtime/deformation/deformation_accuracy_test.cpp). The error is in the springs, not in
// the Winkler foundation: under a tool that covers the whole sheet, the stiffness is exactly f
// times the area. Therefore f is taken from the exact solution of the continuum, and T is lowered
// until the mean stiffness at several positions in an unbounded sheet, with meshes of the same
// grading, equals K. This lowers T by 5 to 8 %, which shortens the decay length lambda by 2 to 4 %
// (if lambda is at least 1.5 circumradii of the tool).
// Tests: tests/runtime/deformation/deformation_accuracy_test.cpp
#pragma once

#include "formats/base/result.h"
#include "runtime/deformation/region.h"

namespace trocar::runtime {

struct Calibration {
  Membrane membrane;  ///< calibrated T and f
  double excess = 0;  ///< mean of K_mesh / K_exact - 1 before the calibration
  double spread = 0;  ///< largest relative deviation of a position's stiffness from the mean
  double exact_foundation_N_per_m3 = 0;  ///< f of the exact solution (unbounded.h)
};

/// Finds T and f. `tool`: outline of the upright tool on the lattice, at any position. If
/// grading.graded is false, regions keep the mesh of the slice, whose grading is unknown, so the
/// function returns T and f of the exact solution. Errors: kRefused if the stiffness or the decay
/// length is not positive, if the decay length exceeds 2^26 steps, or if the outline is not a
/// simple polygon or is too large; kBug if a region cannot be solved. Takes about 30 ms, because
/// twelve regions are meshed and each is solved seven times.
Result<Calibration> calibrate(double stiffness_N_per_m, double decay_length_m, const Ring& tool,
                              const Lattice& lattice, const Grading& grading = {});

}  // namespace trocar::runtime
