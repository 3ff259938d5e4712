// SPDX-License-Identifier: Apache-2.0
// The force with which a tip breaks through a thin wall of cortical bone that has nothing behind it, such as the
// wall of a pedicle. The model of the wall is a rigid-plastic plate that is simply supported or clamped along a
// circle, whose radius is the free radius. The plate breaks either by bending along plastic hinge lines (H.
// Hopkins, W. Prager, J. Mech. Phys. Solids 2, 1953, for a plate that is loaded over a disc) or by punching,
// whichever needs less force. This is experimental: measured forces of thin walls differ from the result by
// factors of up to 3 (tests/bench/published_forces.json).
//
// Contract (tests/runtime/bone_cutting/material/thin_wall_test.cpp):
//  1. bending = clamping * pi * flow * t^2 / 4 / (1 - 2 a / (3 R)), where t is the thickness, a the radius of the
//     tip (at most R) and R the free radius. punching = 2 pi a t * shear.
//  2. The flow stress of cortex is 100 MPa at 1.9 g/cm^3. It is proportional to the square of the
//     apparent density.
#pragma once

namespace trocar::runtime {

struct ThinWall {
  double thickness_m = 0, free_radius_m = 0;
  double flow_Pa = 100e6;  ///< flow stress in bending
  double shear_Pa =
      51.6e6;           ///< shear strength of cortex (C. Turner et al., J. Orthop. Res. 19, 2001)
  double clamping = 3;  ///< 2: simply supported; 4: clamped
};

/// Flow stress of cortical bone. The argument is its apparent density.
double cortex_flow_Pa(double apparent_g_per_cm3) noexcept;

double bending_N(const ThinWall& wall, double tip_radius_m) noexcept;
double punching_N(const ThinWall& wall, double tip_radius_m) noexcept;
/// The smaller of bending and punching.
double break_N(const ThinWall& wall, double tip_radius_m) noexcept;

}  // namespace trocar::runtime
