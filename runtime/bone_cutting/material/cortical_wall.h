// SPDX-License-Identifier: Apache-2.0
// Finds a wall of cortical bone that is thinner than its slice. The HU of such a slice are the
// mean of the wall and of the bone behind it, so a strength from these HU would be too low in the
// wall and too high behind it. If the HU of cortical bone are known, the wall's thickness follows
// from the slice's mean HU (cortical bone mapping, after G. Treece et al., Med. Image Anal. 14,
// 2010, but without a model of the scanner's blur).
//
// Contract (tests/runtime/bone_cutting/material/cortical_wall_test.cpp):
//  1. A slab has the mean HU `slab_HU` if it consists of a wall of `cortex_HU` with the returned
//     thickness, and of bone of `inside_HU` in the rest.
//  2. If the slab's mean is above `cortex_HU`, the wall fills the slab.
//  3. There is no wall (thickness 0) unless the slab's mean exceeds `inside_HU` by at least
//     kMinContrast_HU and the wall is at least kMinWall_m thick. Cancellous bone varies by less
//     than kMinContrast_HU from slice to slice, so its variation is not taken for a wall.
#pragma once

namespace trocar::runtime {

/// HU of cortical bone that are assumed if the scene states neither SceneBody::cortex_HU nor a
/// shell. Cortical bone usually has 1,000 to 1,500 HU.
inline constexpr double kAssumedCortex_HU = 1200;
inline constexpr double kMinContrast_HU = 200, kMinWall_m = 0.4e-3;

/// Returns the thickness of the wall at a face of a slab of bone. `slab_HU`: mean HU of the slab.
/// `inside_HU`: HU of the bone behind the wall, which is the bone of the next slab.
double wall_thickness_m(double slab_HU, double inside_HU, double cortex_HU,
                        double slab_thickness_m) noexcept;

}  // namespace trocar::runtime
