// SPDX-License-Identifier: Apache-2.0
// Computes the response of a sheet to the tool at one position: the stiffness under the tool, the
// point where the force acts, and the shape of the sheet. Usually only a region of the sheet around
// the tool is computed, so the response also has bounds on the errors of stiffness and shape. A
// worker computes the response in advance. The force is linear in the depth, so a haptic tick only
// multiplies the stiffness by the depth.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <span>

#include "runtime/deformation/local_solver.h"
#include "runtime/deformation/region.h"

namespace trocar::runtime {

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
