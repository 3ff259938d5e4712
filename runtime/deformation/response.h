// SPDX-License-Identifier: Apache-2.0
// What a sheet answers to the tool at one place: a stiffness, where the force acts, the sheet's
// shape, and how far all that may be from the whole sheet's answer. A worker prepares it; since
// the problem is linear in the depth, a haptic tick needs only the product stiffness * depth.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <span>

#include "runtime/deformation/local_solver.h"
#include "runtime/deformation/region.h"

namespace trocar::runtime {

struct ResponseOptions {
  /// > 0: the radius is chosen so that both bounds (force, displacement) are at most this, and
  /// region.radius_m is ignored. 0: region.radius_m, whatever the bounds then are.
  double error_bound = 0.01;
  RegionOptions region;
};

/// Plain numbers, to be handed to the haptic thread.
struct RegionResponse {
  double stiffness_N_per_m = 0;  ///< force on the tool per depth; 0: there is nothing under it
  /// Where the reaction's resultant acts, in the slice plane, lattice steps (not rounded).
  Eigen::Vector2d centre_steps = Eigen::Vector2d::Zero();
  double radius_m = 0;  ///< of the region; infinite if it is the whole sheet
  RingBounds bounds;    ///< relative; `force` refers to stiffness_N_per_m
  std::uint32_t nodes = 0, free_nodes = 0;
  std::uint32_t negative_springs = 0;  ///< of free nodes
};

/// All that belongs to one place of the tool.
struct Region {
  RegionMesh mesh;
  Network network;
  LocalSolution solution;  ///< solution.w: the shape for depth 1, for the display
  RegionResponse response;
};

/// Arguments as for make_region. Allocates; some 200 us for 200 free nodes. Errors: as cut().
Result<Region> prepare_region(const SheetMesh& sheet, std::span<const std::uint32_t> seeds,
                              const Ring& tool, const Lattice& lattice, const Membrane& membrane,
                              const ResponseOptions& options, RegionWorkspace& workspace);

}  // namespace trocar::runtime
