// SPDX-License-Identifier: Apache-2.0
// A sheet's calibration, and its response to the tool at one position.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <span>

#include "formats/base/result.h"
#include "runtime/haptics/membrane/region.h"

namespace trocar::runtime {

// Finds the two constants of a sheet with which it has a given stiffness K under the tool. The
// constants are the membrane tension T (force per length) and the stiffness f per area of the
// Winkler foundation, which consists of a spring between each node and a fixed ground (network.h).
// The sheet has no hole, and the tool is far from any edge. The decay length lambda = sqrt(T / f),
// over which a displacement decays, is given for the continuum.
//
// The mesh of a sheet is stiffer than the continuum. The excess stiffness arises mostly along the
// tool's outline and at its corners. It is nearly the same at every position of the tool: 4 to 5 %
// of K with the default grading (triangle sizes, region.h), with a spread of 0.3 %
// (tests/runtime/haptics/membrane/deformation_accuracy_test.cpp). The excess comes from the springs
// along the edges of the mesh, which represent the membrane, and not from the foundation. (Under a
// tool that covers the whole sheet, only the foundation acts, and the stiffness is exactly f times
// the area.) Therefore the calibration corrects only T:
//  1. T and f are computed from the exact solution of the continuum for K and lambda (network.h).
//  2. T is lowered until the mesh of a very large sheet has the stiffness K on average over twelve
//     positions of the tool. The stiffness f is kept.
// Step 2 lowers T by 5 to 8 %, and thereby shortens lambda by 2 to 4 %, if the given lambda is at
// least 1.5 circumradii of the tool.

struct Calibration {
  Membrane membrane;  ///< calibrated T and f
  double excess = 0;  ///< mean excess of the mesh's stiffness before T is lowered, divided by K
  double spread = 0;  ///< largest relative difference of one position's stiffness from the mean
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

// Computes the response of a sheet to the tool at one position: the stiffness under the tool, the
// point where the force acts, and the shape of the sheet. Usually only a region of the sheet around
// the tool is computed, so the response also has bounds on the errors of stiffness and shape. A
// worker computes the response in advance. The force is linear in the depth, so a haptic tick only
// multiplies the stiffness by the depth.

struct ResponseOptions {
  /// If positive, the radius of the region is chosen so that both bounds of RingBounds are
  /// at most this value, and region.radius_m is ignored. If 0, region.radius_m is used,
  /// whatever the bounds.
  double error_bound = 0.01;
  RegionOptions region;
};

/// The numbers of a response.
struct RegionResponse {
  double stiffness_N_per_m = 0;  ///< force on the tool per depth; 0: the tool misses the sheet
  /// Point in the slice plane where the total force on the tool acts, in lattice
  /// steps (not rounded).
  Eigen::Vector2d centre_steps = Eigen::Vector2d::Zero();
  double radius_m = 0;  ///< radius of the region; infinite if it is the whole sheet
  RingBounds bounds;    ///< `force` is relative to stiffness_N_per_m
  std::uint32_t nodes = 0, free_nodes = 0;  ///< number of all nodes, and of the free ones (kFree)
  std::uint32_t negative_springs = 0;       ///< number of negative springs at free nodes
};

/// Mesh, network, solution and response for one position of the tool.
struct Region {
  RegionMesh mesh;
  Network network;
  LocalSolution solution;  ///< solution.w: the shape for depth 1, for the display
  RegionResponse response;
};

/// Computes the response. `sheet`, `seeds`, `tool`, `lattice` and `workspace` are as for
/// make_region(). Allocates. Takes about 300 us for 200 free nodes. Errors: those of make_region();
/// also kBug if the region cannot be solved.
Result<Region> prepare_region(const SheetMesh& sheet, std::span<const std::uint32_t> seeds,
                              const Ring& tool, const Lattice& lattice, const Membrane& membrane,
                              const ResponseOptions& options, RegionWorkspace& workspace);

}  // namespace trocar::runtime
