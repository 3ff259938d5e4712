// SPDX-License-Identifier: Apache-2.0
// T and f for which an undamaged sheet far from any edge has the stiffness K.
//
// Finite elements of a given size are stiffer than the continuum. Under a tool the excess arises
// mostly along its outline and at its corners, and is nearly the same at every position: 4 to 5 % with
// the default grading, with a spread of 0.3 %
// (tests/runtime/deformation/deformation_accuracy_test.cpp). The error is in the springs, not in the Winkler foundation.
// So f is taken from the exact solution (under a tool that covers the whole sheet the stiffness is
// exactly f times the area), and T is lowered until meshes of the same grading, in an unbounded
// sheet, have K on average. T falls by 5 to 8 %, which shortens the decay length by 2 to 4 % (if lambda is at
// least 1.5 circumradii).
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

/// `tool`: its upright outline on the lattice, at any position. With grading.graded = false the mesh
/// is the slice's own, of unknown grading: the result has the exact constants. Refused: a stiffness
/// or decay length that is not positive, a decay length of more than 2^26 steps, an outline that is not a simple polygon.
/// Some 30 ms: twelve regions are meshed, and each is solved seven times.
Result<Calibration> calibrate(double stiffness_N_per_m, double decay_length_m, const Ring& tool,
                              const Lattice& lattice, const Grading& grading = {});

}  // namespace trocar::runtime
