// SPDX-License-Identifier: Apache-2.0
#include "runtime/bone_cutting/material/thin_wall.h"

#include <algorithm>
#include <numbers>

namespace trocar::runtime {

using std::numbers::pi;

double cortex_flow_Pa(double apparent_g_per_cm3) noexcept {
  const double relative = apparent_g_per_cm3 / 1.9;
  return 100e6 * relative * relative;
}

double bending_N(const ThinWall& wall, double tip_radius_m) noexcept {
  const double a = std::min(tip_radius_m, wall.free_radius_m);
  const double moment_N = wall.flow_Pa * wall.thickness_m * wall.thickness_m / 4;
  return wall.clamping * pi * moment_N / (1 - 2 * a / (3 * wall.free_radius_m));
}

double punching_N(const ThinWall& wall, double tip_radius_m) noexcept {
  return 2 * pi * tip_radius_m * wall.thickness_m * wall.shear_Pa;
}

double break_N(const ThinWall& wall, double tip_radius_m) noexcept {
  return std::min(bending_N(wall, tip_radius_m), punching_N(wall, tip_radius_m));
}

}  // namespace trocar::runtime
