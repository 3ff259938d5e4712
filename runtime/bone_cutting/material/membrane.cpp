// SPDX-License-Identifier: Apache-2.0
#include "runtime/bone_cutting/material/membrane.h"

#include <algorithm>
#include <cmath>

namespace trocar::runtime {

double membrane_break_N(double toughness_J_per_m2, double thickness_m,
                        const ToolShape& tool) noexcept {
  double crack_m = torn_length_m(tool);
  if (!is_flat(tool)) crack_m = std::min(crack_m, 2 * thickness_m * std::tan(tool.half_angle_rad));
  return toughness_J_per_m2 * crack_m / kTearingFraction;
}

}  // namespace trocar::runtime
