// SPDX-License-Identifier: Apache-2.0
// Computes how the strength of bone varies with depth within each slab, from one strength per
// slice. A slab extends half-way to the neighbouring slices. Within a slab the strength is linear
// in depth, and the mean of the strength is the slice's value, wherever the slice lies in the slab.
// So the work of cutting through the slab is the slab's thickness times the slice's value. A
// cortical shell can replace part of the bone (contract 2). A session uses only strength_ends().
// Tests and benchmarks call make_slabs().
//
// Contract (tests/runtime/bone_cutting/material/slabs_test.cpp):
//  1. The slabs cover the volume without gaps, from half a spacing above the first slice to half
//     a spacing below the last. The mean strength of a slab is the value of its slice. In the first
//     and the last slab the strength is constant. In every other slab the straight line through the
//     values of the two neighbouring slices gives the slope of the strength. A slope limiter (B.
//     van Leer, J. Comput. Phys. 23, 1977) reduces the slope where the strength at an end of the
//     slab would leave an allowed range. The range goes from the smaller to the larger of two
//     values, the slab's own and that of the neighbour on that side, and is then widened by 5 % of
//     the slab's own value on either side. It contains no negative values. The range prevents
//     overshoot at a jump, such as a thin cortex next to soft bone. Because of the 5 %, a strength
//     that varies smoothly keeps its maxima.
//  2. A shell replaces the bone that it covers. If a slab touches the shell, the value of its slice
//     contains part of the shell and is not used. The remaining bone of this slab gets the value of
//     the nearest slice whose slab the shell does not touch.
#pragma once

#include <array>
#include <span>
#include <vector>

#include "runtime/bone_cutting/law/cutting_law.h"

namespace trocar::runtime {

/// Values at one slice. The friction and the two wall values mean the same as in CuttingSlab.
struct BodySlice {
  double depth_m = 0;
  double strength_N = 0;  ///< force on the tip at which the cutting front advances
  double friction_N_per_m = 0, wall_N_per_m2 = 0, wall_strength_N_per_m = 0;
};

struct BodyShell {
  double top_m = 0, thickness_m = 0, strength_N = 0;  ///< top_m: depth of the shell's top
};

/// Returns the strength at the top and at the bottom of a slab (contract 1). `above_N`,
/// `above_gap_m`: strength and distance of the slice above; a distance of 0 means that there is
/// none. `below_N`, `below_gap_m`: likewise for the slice below.
std::array<double, 2> strength_ends(double strength_N, double above_N, double above_gap_m,
                                    double below_N, double below_gap_m,
                                    double thickness_m) noexcept;

/// Makes the slabs. `clearance_m`: CuttingSlab::clearance_m of every slab. Throws
/// std::invalid_argument if the depths do not ascend, if shells overlap, or if the thickness of a
/// shell is not positive. For fewer than two slices the result is empty, because there is no
/// spacing.
std::vector<CuttingSlab> make_slabs(std::span<const BodySlice> slices,
                                    std::span<const BodyShell> shells, double clearance_m);

}  // namespace trocar::runtime
