// SPDX-License-Identifier: Apache-2.0
// The force with which a tool breaks through a layer of soft tissue, from the tissue's fracture toughness. A
// pointed tip opens a crack that is as long as the tip is wide where it leaves the layer, but never longer than
// the crack that the whole tool opens (torn_length_m). Spreading the tissue and friction add to the force of
// tearing (A. Barnett, Y.-S. Lee, J. Moore, J. Manuf. Sci. Eng. 138, 2016: tearing takes 61 %).
//
// Contract (tests/runtime/bone_cutting/material/membrane_test.cpp):
//  1. force = toughness * min(torn length, 2 h tan(half angle)) / 0.61 for a pointed tip and a layer of thickness
//     h; toughness * torn length / 0.61 for a flat or hollow tip.
#pragma once

#include "runtime/bone_cutting/material/tool_in_tissue.h"

namespace trocar::runtime {

/// Tearing as a fraction of the force.
inline constexpr double kTearingFraction = 0.61;

/// `toughness_J_per_m2`: work for each area of crack. The tool must be without error.
double membrane_break_N(double toughness_J_per_m2, double thickness_m,
                        const ToolShape& tool) noexcept;

}  // namespace trocar::runtime
