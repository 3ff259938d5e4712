// SPDX-License-Identifier: Apache-2.0
// Finds a wall of cortical bone that is thinner than its slab (the bone around one slice). The HU
// of such a slab are the mean of the wall and of the bone behind the wall. A strength from these HU
// would be too low in the wall and too high behind it. If the HU of cortical bone are known, the
// wall's thickness follows from the slab's mean HU (cortical bone mapping, after G. Treece et al.,
// Med. Image Anal. 14, 2010, but without a model of the scanner's blur).
//
// Contract (tests/runtime/bone_cutting/material/cortical_wall_test.cpp):
//  1. The result is 0 (no wall) if `slab_HU` exceeds `inside_HU` by less than kMinContrast_HU, or
//     if the wall of items 2 and 3 would be thinner than kMinWall_m. The HU of cancellous bone (the
//     porous bone inside) vary by less than kMinContrast_HU from slice to slice, so cancellous bone
//     is not taken for a wall.
//  2. Otherwise, if `slab_HU` is at least `cortex_HU`, the wall fills the slab.
//  3. Otherwise, the result is the thickness t for which `slab_HU` is the mean of two parts, each
//     weighted by its thickness: a wall of thickness t with the HU `cortex_HU`, and the rest of the
//     slab with the HU `inside_HU`.
#pragma once

namespace trocar::runtime {

/// HU of cortical bone that are assumed if the scene states neither SceneBody::cortex_HU nor a
/// shell (an outer layer of bone with a given thickness). Cortical bone usually has 1,000 to 1,500
/// HU.
inline constexpr double kAssumedCortex_HU = 1200;
inline constexpr double kMinContrast_HU = 200, kMinWall_m = 0.4e-3;

/// Returns the thickness of the wall at a face of a slab of bone. `slab_HU`: mean HU of the slab.
/// `inside_HU`: HU of the bone behind the wall, which is the bone of the next slab.
double wall_thickness_m(double slab_HU, double inside_HU, double cortex_HU,
                        double slab_thickness_m) noexcept;

}  // namespace trocar::runtime
