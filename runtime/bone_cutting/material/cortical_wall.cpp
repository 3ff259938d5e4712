// SPDX-License-Identifier: Apache-2.0
#include "runtime/bone_cutting/material/cortical_wall.h"

#include <algorithm>

namespace trocar::runtime {

double wall_thickness_m(double slab_HU, double inside_HU, double cortex_HU,
                        double slab_thickness_m) noexcept {
  if (!(slab_HU - inside_HU >= kMinContrast_HU)) return 0;
  const double wall_m =
      slab_thickness_m * (slab_HU - inside_HU) / (std::max(cortex_HU, slab_HU) - inside_HU);
  return wall_m >= kMinWall_m ? wall_m : 0;
}

}  // namespace trocar::runtime
