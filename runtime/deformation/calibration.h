// SPDX-License-Identifier: Apache-2.0
// Finds the membrane tension T and the foundation stiffness f with which a sheet has a given
// stiffness K under the tool. The sheet is one without a hole, and the tool is far from any edge.
//
// A mesh of finite elements is stiffer than the continuum. Under a tool the excess stiffness arises
// mostly along the tool's outline and at its corners. The excess is nearly the same at every
// position of the tool: 4 to 5 % of K with the default grading (triangle sizes, region.h), with a
// spread of 0.3 % (tests/runtime/deformation/deformation_accuracy_test.cpp). The springs cause the
// excess, not the Winkler foundation: under a tool that covers the whole sheet, the stiffness is
// exactly f times the area. Therefore f is taken from the exact solution of the continuum
// (unbounded.h). Then T is lowered. The mesh of a very large sheet then has the stiffness K on
// average over several positions of the tool. If the decay length lambda is at least 1.5
// circumradii of the tool, this lowers T by 5 to 8 %, and shortens lambda by 2 to 4 %.
// Tests: tests/runtime/deformation/deformation_accuracy_test.cpp
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
/// the function returns T and f of the exact solution, because the triangle sizes of a session's
/// regions are then not known in advance. Takes about 30 ms, because twelve regions are meshed and
/// each region is solved seven times. Errors: kRefused if the stiffness or the decay length is not
/// positive, if the decay length exceeds 2^26 steps, or if the outline is not a simple polygon or
/// is too large for the lattice; kBug if a region cannot be solved.
Result<Calibration> calibrate(double stiffness_N_per_m, double decay_length_m, const Ring& tool,
                              const Lattice& lattice, const Grading& grading = {});

}  // namespace trocar::runtime
