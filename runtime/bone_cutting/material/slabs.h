// SPDX-License-Identifier: Apache-2.0
// Makes the slabs of a bone volume from values at its slices. A slab extends half-way to its neighbours. Within
// it the strength is linear about the slice's value, so that the slab's work is that of the slice's mean
// whatever the slices' positions are. A shell has a thickness and strength of its own.
//
// Contract (tests/runtime/bone_cutting/material/slabs_test.cpp):
//  1. The slabs cover the volume without gaps, from half a spacing above the first slice to half a spacing
//     below the last. A slab's mean strength is its slice's. Its slope is that of the line through its
//     neighbours, limited so that each end lies between the slab's own strength and that of the neighbour on that
//     side, or at most 5 % of its own strength beyond (a slope limiter: B. van Leer, J. Comput. Phys. 23, 1977).
//     So a thin cortex beside soft bone causes neither a peak nor a dip that the slices do not have, and a smooth
//     texture keeps its peaks. The first and the last slab are constant.
//  2. A shell replaces what it covers. Slices whose slab it touches contain part of the shell in their mean,
//     so they are ignored: the strength of the nearest slab that the shell does not touch is used.
#pragma once

#include <array>
#include <span>
#include <vector>

#include "runtime/bone_cutting/law/cutting_law.h"

namespace trocar::runtime {

struct BodySlice {
  double depth_m = 0;
  double strength_N = 0;  ///< strength of the front
  double friction_N_per_m = 0, wall_N_per_m2 = 0, wall_strength_N_per_m = 0;
};

struct BodyShell {
  double top_m = 0, thickness_m = 0, strength_N = 0;  ///< top_m: depth
};

/// The strength at the top and the bottom of a slab (contract 1). A neighbour with gap 0 does not exist. Never
/// negative.
std::array<double, 2> strength_ends(double strength_N, double above_N, double above_gap_m,
                                    double below_N, double below_gap_m,
                                    double thickness_m) noexcept;

/// Depths must ascend; shells must not overlap. Throws std::invalid_argument. Empty for
/// fewer than two slices, which have no spacing.
std::vector<CuttingSlab> make_slabs(std::span<const BodySlice> slices,
                                    std::span<const BodyShell> shells, double clearance_m);

}  // namespace trocar::runtime
