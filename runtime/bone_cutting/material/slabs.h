// SPDX-License-Identifier: Apache-2.0
// Makes the slabs of a bone volume from values at its slices. A slab extends half-way to its neighbours. Within
// a slab the strength is linear in depth, and its mean is the slice's value, wherever the slice lies in the
// slab. The work of cutting the slab then equals that of the mean strength. A shell has a thickness and
// strength of its own.
//
// Contract (tests/runtime/bone_cutting/material/slabs_test.cpp):
//  1. The slabs cover the volume without gaps, from half a spacing above the first slice to half a spacing below
//     the last. A slab's mean strength is its slice's. Its slope is that of the line through its neighbours,
//     within a limit (a slope limiter: B. van Leer, J. Comput. Phys. 23, 1977): each end lies between the slab's
//     own strength and that of the neighbour on that side, or at most 5 % of the slab's own strength outside this
//     range. So a thin cortex next to soft bone causes neither a peak nor a dip that the slices do not have, and
//     a smooth texture keeps its peaks. In the first and the last slab the strength is constant.
//  2. A shell replaces the bone that it covers. The mean strength of a slice whose slab touches the shell
//     contains part of the shell, so this slice is ignored. The strength of the nearest slab that the shell does
//     not touch is used instead.
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

/// The strength at the top and the bottom of a slab (contract 1), never negative. A gap of 0 means that there is
/// no neighbour on that side.
std::array<double, 2> strength_ends(double strength_N, double above_N, double above_gap_m,
                                    double below_N, double below_gap_m,
                                    double thickness_m) noexcept;

/// The depths must ascend, and the shells must not overlap; otherwise throws std::invalid_argument. The result is
/// empty for fewer than two slices, because these have no spacing.
std::vector<CuttingSlab> make_slabs(std::span<const BodySlice> slices,
                                    std::span<const BodyShell> shells, double clearance_m);

}  // namespace trocar::runtime
