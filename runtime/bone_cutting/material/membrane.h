// SPDX-License-Identifier: Apache-2.0
// The force with which a tool breaks through a layer of soft tissue, computed from the tissue's
// fracture toughness. A pointed tip opens a crack. When the point comes out of the bottom of the
// layer, the length of the crack equals the width of the tip at the top of the layer, but is at
// most the length of the crack that the whole tool opens (torn_length_m()). Tearing accounts for
// 61 % of the force on the tool, and spreading and friction account for the rest (A. Barnett, Y.-S.
// Lee, J. Moore, J. Manuf. Sci. Eng. 138, 2016).
//
// Contract (tests/runtime/bone_cutting/material/membrane_test.cpp):
//  1. Let h be the thickness of the layer, and alpha the half angle of the tip
//     (ToolShape::half_angle_rad).
//       pointed tip: force = toughness * min(torn length, 2 h tan(alpha)) / 0.61
//       flat or hollow tip: force = toughness * torn length / 0.61
#pragma once

#include "runtime/bone_cutting/material/tool_in_tissue.h"

namespace trocar::runtime {

/// Force of tearing divided by the whole force on the tool.
inline constexpr double kTearingFraction = 0.61;

/// Returns the force (contract 1). `toughness_J_per_m2`: work per area of crack. Precondition: the
/// tool is valid (error_of()).
double membrane_break_N(double toughness_J_per_m2, double thickness_m,
                        const ToolShape& tool) noexcept;

}  // namespace trocar::runtime
