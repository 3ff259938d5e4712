// SPDX-License-Identifier: Apache-2.0
// T and f such that an undamaged sheet far from any edge feels exactly the stiffness K.
//
// Finite elements of a given size are stiffer than what they stand for, under a tool mostly along
// its outline and at its corners, and by nearly the same share wherever the tool is: with the usual
// grading 4 to 5 %, give or take 0.3 % from place to place
// (tests/runtime/deformation/deformation_accuracy_test.cpp). The excess is in the springs, not in
// the bed. So f is the exact solution's (a tool that covers all there is feels f times the area,
// exactly), and T is lowered until meshes made in the same way, in a sheet without end, have K on
// average: by 5 to 8 %, which shortens the reach by 2 to 4 % (for lambda >= 1.5 circumradii).
#pragma once

#include "formats/base/result.h"
#include "runtime/deformation/region.h"

namespace trocar::runtime {

struct Calibration {
  Membrane membrane;              ///< to be used
  double excess = 0;              ///< before: mean of K_mesh / K_exact - 1
  double spread = 0;              ///< largest deviation from that mean over the places looked at
  double exact_bed_N_per_m3 = 0;  ///< the exact solution's f (unbounded.h)
};

/// `tool`: its upright outline on the lattice, wherever it lies. With grading.graded = false the
/// mesh is the slice's own and nothing general can be said of it: the exact constants. Refused: a
/// stiffness or reach that is not positive, a reach of more than 2^26 steps, a tool that is none.
/// O(some ms): a dozen regions are meshed and solved.
Result<Calibration> calibrate(double stiffness_N_per_m, double reach_m, const Ring& tool,
                              const Lattice& lattice, const Grading& grading = {});

}  // namespace trocar::runtime
