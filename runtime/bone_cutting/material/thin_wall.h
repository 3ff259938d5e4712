// SPDX-License-Identifier: Apache-2.0
// The force with which a tip breaks through a thin wall of cortical bone that has nothing behind
// it, such as the wall of a pedicle. The model of the wall is a rigid-plastic plate. The plate is
// simply supported or clamped along a circle whose radius is called the free radius. It breaks by
// bending along plastic hinge lines (H. Hopkins, W. Prager, J. Mech. Phys. Solids 2, 1953, for a
// plate that is loaded over a disc) or by punching, whichever needs less force. The model is
// experimental: measured forces of thin walls differ from its results by factors of up to 3
// (tests/bench/published_forces.json).
//
// Contract (tests/runtime/bone_cutting/material/thin_wall_test.cpp):
//  1. Let t be the thickness, a the radius of the tip and R the free radius. The other names are
//     members of ThinWall.
//       bending = clamping * pi * (flow * t^2 / 4) / (1 - 2 min(a, R) / (3 R))
//       punching = 2 pi a t * shear
//  2. The flow stress of cortex is proportional to the square of the apparent density. At
//     1.9 g/cm^3 the flow stress is 100 MPa.
#pragma once

namespace trocar::runtime {

struct ThinWall {
  double thickness_m = 0, free_radius_m = 0;
  double flow_Pa = 100e6;  ///< flow stress in bending
  double shear_Pa =
      51.6e6;           ///< shear strength of cortex (C. Turner et al., J. Orthop. Res. 19, 2001)
  double clamping = 3;  ///< edge of the wall; 2: simply supported, 4: clamped, 3: in between
};

/// Flow stress of cortical bone of this apparent density (contract 2).
double cortex_flow_Pa(double apparent_g_per_cm3) noexcept;

double bending_N(const ThinWall& wall, double tip_radius_m) noexcept;
double punching_N(const ThinWall& wall, double tip_radius_m) noexcept;
/// Returns the smaller of bending_N() and punching_N().
double break_N(const ThinWall& wall, double tip_radius_m) noexcept;

}  // namespace trocar::runtime
