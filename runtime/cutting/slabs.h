// SPDX-License-Identifier: Apache-2.0
// The slabs of a body from values at its slices. A slab reaches half-way to its neighbours; within,
// the strength is linear about the slice's value, so that the slab's work is that of the slice's
// mean however the slices fall. A shell has a thickness and strength of its own.
//
// Contract (tests/runtime/cutting/slabs_test.cpp):
//  1. The slabs cover the body without gaps, from half a spacing above the first slice to half a
//     spacing below the last. A slab's mean strength is its slice's; its slope that of the line
//     through its neighbours, less where the strength would become negative.
//  2. A shell replaces what it covers. Slices whose slab it touches hold part of it in their mean,
//     so they do not count: the strength of the nearest slab that it does not touch is taken.
#pragma once

#include <array>
#include <span>
#include <vector>

#include "runtime/cutting/cutting_law.h"

namespace trocar::runtime {

struct BodySlice {
  double depth_m = 0;
  double strength_N = 0;  ///< of the front
  double friction_N_per_m = 0, wall_N_per_m2 = 0, wall_strength_N_per_m = 0;
};

struct BodyShell {
  double top_m = 0, thickness_m = 0, strength_N = 0;  ///< top_m: depth
};

/// The strength at the top and the bottom of a slab about its slice's: along the line through its
/// neighbours, of which one without a gap (0) does not count; never negative.
std::array<double, 2> strength_ends(double strength_N, double above_N, double above_gap_m,
                                    double below_N, double below_gap_m,
                                    double thickness_m) noexcept;

/// Depths must ascend; shells must not overlap. Throws std::invalid_argument. Fewer than two slices
/// have no spacing: nothing.
std::vector<CuttingSlab> make_slabs(std::span<const BodySlice> slices,
                                    std::span<const BodyShell> shells, double clearance_m);

}  // namespace trocar::runtime
