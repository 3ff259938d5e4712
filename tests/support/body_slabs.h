// SPDX-License-Identifier: Apache-2.0
// The slabs of a body from one strength per slice, for tests and measurements of the cutting law. A
// session makes its slabs in runtime/haptics/bone/bone_volume.cpp, and gives each the ends
// of strength_ends(), too.
// The slabs cover the volume without gaps, from half a spacing above the first slice to half a
// spacing below the last.
#pragma once

#include <span>
#include <vector>

#include "runtime/haptics/bone/bone_volume.h"
#include "runtime/haptics/bone/cutting_law.h"

namespace trocar::runtime {

/// Values at one slice. The friction and the two wall values mean the same as in CuttingSlab.
struct BodySlice {
  double depth_m = 0;
  double strength_N = 0;  ///< force on the tip at which the cutting front advances
  double friction_N_per_m = 0, wall_N_per_m2 = 0, wall_strength_N_per_m = 0;
};

/// Makes the slabs of slices in the order of their depths. For fewer than two slices the result is empty, because there is
/// no spacing.
inline std::vector<CuttingSlab> make_slabs(std::span<const BodySlice> slices) {
  const std::size_t n = slices.size();
  if (n < 2) return {};

  std::vector<CuttingSlab> slabs(n);
  for (std::size_t i = 0; i < n; ++i) {
    const double above = slices[i > 0 ? i : 1].depth_m - slices[i > 0 ? i - 1 : 0].depth_m;
    const double below =
        slices[i + 1 < n ? i + 1 : n - 1].depth_m - slices[i + 1 < n ? i : n - 2].depth_m;
    CuttingSlab& slab = slabs[i];
    slab.top_m = i > 0 ? slabs[i - 1].bottom_m : slices[0].depth_m - above / 2;
    slab.bottom_m = slices[i].depth_m + below / 2;
    slab.friction_N_per_m = slices[i].friction_N_per_m;
    slab.wall_N_per_m2 = slices[i].wall_N_per_m2;
    slab.wall_strength_N_per_m = slices[i].wall_strength_N_per_m;
  }

  for (std::size_t i = 0; i < n; ++i) {
    const std::size_t a = i > 0 ? i - 1 : 0, b = i + 1 < n ? i + 1 : n - 1;
    const auto [top_N, bottom_N] =
        strength_ends(slices[i].strength_N, slices[a].strength_N,
                      slices[i].depth_m - slices[a].depth_m, slices[b].strength_N,
                      slices[b].depth_m - slices[i].depth_m, slabs[i].bottom_m - slabs[i].top_m);
    slabs[i].strength_top_N = top_N;
    slabs[i].strength_bottom_N = bottom_N;
  }
  return slabs;
}

}  // namespace trocar::runtime
