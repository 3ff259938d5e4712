// SPDX-License-Identifier: Apache-2.0
// Finds the two constants of a sheet with which it has a given stiffness K under the tool. The
// constants are the membrane tension T (force per length) and the stiffness f per area of the
// Winkler foundation, which consists of a spring between each node and a fixed ground (network.h).
// The sheet has no hole, and the tool is far from any edge. The decay length lambda = sqrt(T / f),
// over which a displacement decays, is given for the continuum.
//
// The mesh of a sheet is stiffer than the continuum. The excess stiffness arises mostly along the
// tool's outline and at its corners. It is nearly the same at every position of the tool: 4 to 5 %
// of K with the default grading (triangle sizes, region.h), with a spread of 0.3 %
// (tests/runtime/deformation/deformation_accuracy_test.cpp). The excess comes from the springs
// along the edges of the mesh, which represent the membrane, and not from the foundation. (Under a
// tool that covers the whole sheet, only the foundation acts, and the stiffness is exactly f times
// the area.) Therefore the calibration corrects only T:
//  1. T and f are computed from the exact solution of the continuum for K and lambda (unbounded.h).
//  2. T is lowered until the mesh of a very large sheet has the stiffness K on average over twelve
//     positions of the tool. The stiffness f is kept.
// Step 2 lowers T by 5 to 8 %, and thereby shortens lambda by 2 to 4 %, if the given lambda is at
// least 1.5 circumradii of the tool.
#pragma once

#include "formats/base/result.h"
#include "runtime/deformation/region.h"

namespace trocar::runtime {

struct Calibration {
  Membrane membrane;  ///< calibrated T and f
  double excess = 0;  ///< mean excess of the mesh's stiffness before T is lowered, divided by K
  double spread = 0;  ///< largest relative difference of one position's stiffness from the mean
  double exact_foundation_N_per_m3 = 0;  ///< f of the exact solution (unbounded.h)
};

/// Finds T and f. K is `stiffness_N_per_m`, and lambda of the exact solution is `decay_length_m`.
/// `tool`: outline of the upright tool on the lattice, at any position. If grading.graded is false,
/// a region keeps the triangles of the session's sheet. The excess then depends on the position of
/// the tool and is not known in advance, so the function returns T and f of the exact solution.
/// Otherwise the function takes about 30 ms, because twelve regions are meshed and each region is
/// solved seven times. Errors: kRefused if the stiffness or the decay length is not positive, if
/// the decay length exceeds 2^26 steps, or if the outline is not a simple polygon or is too large
/// for the lattice; kBug if a region cannot be solved.
Result<Calibration> calibrate(double stiffness_N_per_m, double decay_length_m, const Ring& tool,
                              const Lattice& lattice, const Grading& grading = {});

}  // namespace trocar::runtime
