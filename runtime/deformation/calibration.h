// SPDX-License-Identifier: Apache-2.0
// T and f for which an undamaged sheet far from any edge has the stiffness K.
//
// Finite elements of a given size are stiffer than the continuum. Under a tool the excess arises
// mostly along its outline and at its corners, and is nearly the same at every place: 4 to 5 % with
// the default grading, within 0.3 % from place to place
// (tests/runtime/deformation/deformation_accuracy_test.cpp). It is in the springs, not in the bed.
// So f is taken from the exact solution (under a tool that covers the whole sheet the stiffness is
// exactly f times the area), and T is lowered until meshes of the same grading, in an unbounded
// sheet, have K on average: by 5 to 8 %, which shortens the reach by 2 to 4 % (for lambda >= 1.5
// circumradii).
#pragma once

#include "formats/base/result.h"
#include "runtime/deformation/region.h"

namespace trocar::runtime {

struct Calibration {
  Membrane membrane;  ///< calibrated
  double excess = 0;  ///< without calibration: mean of K_mesh / K_exact - 1
  double spread = 0;  ///< largest relative deviation from the mean over the sampled places
  double exact_bed_N_per_m3 = 0;  ///< f of the exact solution (unbounded.h)
};

/// `tool`: its upright outline on the lattice, at any place. With grading.graded = false the mesh
/// is the slice's own, of unknown grading: the result has the exact constants. Refused: a stiffness
/// or reach that is not positive, a reach of more than 2^26 steps, an outline that is no tool's.
/// Some 30 ms: twelve regions are meshed, and each is solved seven times.
Result<Calibration> calibrate(double stiffness_N_per_m, double reach_m, const Ring& tool,
                              const Lattice& lattice, const Grading& grading = {});

}  // namespace trocar::runtime
