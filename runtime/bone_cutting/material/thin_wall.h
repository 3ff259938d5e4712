// SPDX-License-Identifier: Apache-2.0
// The force with which a tip breaks through a thin wall of cortical bone that has nothing behind it, such as the
// wall of a pedicle. The wall is a rigid-plastic plate, simply supported or clamped at a free radius. It breaks by
// bending along plastic hinge lines (H. Hopkins, W. Prager, J. Mech. Phys. Solids 2, 1953, for a plate that is
// loaded over a disc) or by punching, whichever needs less force. Experimental: measured forces of thin walls
// differ from it by factors of up to 3 (tests/bench/published_forces.json).
//
// Contract (tests/runtime/bone_cutting/material/thin_wall_test.cpp):
//  1. bending = clamping * pi * flow * t^2 / 4 / (1 - 2 a / (3 R)), with the thickness t, the radius a of the tip
//     (at most R) and the free radius R. punching = 2 pi a t * shear.
//  2. The flow stress of cortex is 100 MPa at 1.9 g/cm^3 and falls with the square of the apparent density.
#pragma once

namespace trocar::runtime {

struct ThinWall {
  double thickness_m = 0, free_radius_m = 0;
  double flow_Pa = 100e6;  ///< flow stress in bending
  double shear_Pa =
      51.6e6;           ///< shear strength of cortex (C. Turner et al., J. Orthop. Res. 19, 2001)
  double clamping = 3;  ///< 2: simply supported; 4: clamped
};

/// Flow stress of cortical bone of an apparent density in g/cm^3.
double cortex_flow_Pa(double apparent_g_per_cm3) noexcept;

double bending_N(const ThinWall& wall, double tip_radius_m) noexcept;
double punching_N(const ThinWall& wall, double tip_radius_m) noexcept;
/// The smaller of bending and punching.
double break_N(const ThinWall& wall, double tip_radius_m) noexcept;

}  // namespace trocar::runtime
