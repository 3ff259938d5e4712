// SPDX-License-Identifier: Apache-2.0
// Computes how the strength of bone varies with depth within each slab, from one strength per
// slice. A slab extends half-way to the neighbouring slices. Within a slab the strength is linear
// in depth, and the mean of the strength is the slice's value, wherever the slice lies in the slab.
// So the work of cutting through the slab is the slab's thickness times the slice's value.
//
// Contract (tests/runtime/bone_cutting/material/slabs_test.cpp): The mean strength of a slab is the
// value of its slice. In the first and the last slab the strength is constant. In every other slab
// the straight line through the values of the two neighbouring slices gives the slope of the
// strength. A slope limiter (B. van Leer, J. Comput. Phys. 23, 1977) reduces the slope where the
// strength at an end of the slab would leave an allowed range. The range goes from the smaller to
// the larger of two values, the slab's own and that of the neighbour on that side, and is then
// widened by 5 % of the slab's own value on either side. It contains no negative values. The range
// prevents overshoot at a jump, such as a thin cortex next to soft bone. Because of the 5 %, a
// strength that varies smoothly keeps its maxima.
#pragma once

#include <array>

namespace trocar::runtime {

/// Returns the strength at the top and at the bottom of a slab (see above). `above_N`,
/// `above_gap_m`: strength and distance of the slice above; a distance of 0 means that there is
/// none. `below_N`, `below_gap_m`: likewise for the slice below.
std::array<double, 2> strength_ends(double strength_N, double above_N, double above_gap_m,
                                    double below_N, double below_gap_m,
                                    double thickness_m) noexcept;

}  // namespace trocar::runtime
