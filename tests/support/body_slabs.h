// SPDX-License-Identifier: Apache-2.0
// The slabs of a body from one strength per slice, for tests and measurements of the cutting law. A
// session makes its slabs in runtime/haptics/bone/bone_volume.cpp, and gives each the ends
// of strength_ends(), too.
//  1. The slabs cover the volume without gaps, from half a spacing above the first slice to half a
//     spacing below the last.
//  2. A shell replaces the bone that it covers. If a slab touches the shell, the value of its slice
//     contains part of the shell and is not used. The remaining bone of this slab gets the value of
//     the nearest slice whose slab the shell does not touch.
#pragma once

#include <algorithm>
#include <span>
#include <stdexcept>
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

struct BodyShell {
  double top_m = 0, thickness_m = 0, strength_N = 0;  ///< top_m: depth of the shell's top
};

inline bool touches(const CuttingSlab& slab, const BodyShell& shell) {
  return shell.top_m < slab.bottom_m && shell.top_m + shell.thickness_m > slab.top_m;
}

// The strength of a slab at its depths; from..to of it.
inline CuttingSlab part_of(const CuttingSlab& slab, double from_m, double to_m) {
  CuttingSlab part = slab;
  const double slope =
      (slab.strength_bottom_N - slab.strength_top_N) / (slab.bottom_m - slab.top_m);
  part.top_m = from_m;
  part.bottom_m = to_m;
  part.strength_top_N = slab.strength_top_N + slope * (from_m - slab.top_m);
  part.strength_bottom_N = slab.strength_top_N + slope * (to_m - slab.top_m);
  return part;
}

inline void insert(const BodyShell& shell, std::vector<CuttingSlab>& slabs) {
  const double from = shell.top_m, to = shell.top_m + shell.thickness_m;
  std::vector<CuttingSlab> out;
  for (const CuttingSlab& slab : slabs) {
    if (!touches(slab, shell)) {
      out.push_back(slab);
      continue;
    }
    if (slab.top_m < from) out.push_back(part_of(slab, slab.top_m, from));
    CuttingSlab part = part_of(slab, std::max(slab.top_m, from), std::min(slab.bottom_m, to));
    part.strength_top_N = part.strength_bottom_N = shell.strength_N;
    out.push_back(part);
    if (slab.bottom_m > to) out.push_back(part_of(slab, to, slab.bottom_m));
  }
  slabs = std::move(out);
}

/// Makes the slabs. `clearance_m`: CuttingSlab::clearance_m of every slab. Throws
/// std::invalid_argument if the depths do not ascend, if shells overlap, or if the thickness of a
/// shell is not positive. For fewer than two slices the result is empty, because there is no
/// spacing.
inline std::vector<CuttingSlab> make_slabs(std::span<const BodySlice> slices,
                                           std::span<const BodyShell> shells, double clearance_m) {
  const std::size_t n = slices.size();
  if (n < 2) return {};
  for (std::size_t i = 1; i < n; ++i)
    if (!(slices[i].depth_m > slices[i - 1].depth_m))
      throw std::invalid_argument("the slices of a bone must have ascending depths");
  for (std::size_t i = 0; i < shells.size(); ++i) {
    if (!(shells[i].thickness_m > 0))
      throw std::invalid_argument("a shell's thickness must be above 0");
    for (std::size_t k = 0; k < i; ++k)
      if (shells[i].top_m < shells[k].top_m + shells[k].thickness_m &&
          shells[k].top_m < shells[i].top_m + shells[i].thickness_m)
        throw std::invalid_argument("two shells of a bone overlap");
  }

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
    slab.clearance_m = clearance_m;
  }

  // Slices that hold part of a shell take the strength of the nearest that does not.
  std::vector<double> strength(n);
  std::vector<char> counts(n);
  for (std::size_t i = 0; i < n; ++i)
    counts[i] = std::none_of(shells.begin(), shells.end(),
                             [&](const BodyShell& shell) { return touches(slabs[i], shell); });
  for (std::size_t i = 0; i < n; ++i) {
    strength[i] = slices[i].strength_N;
    for (std::size_t d = 1; counts[i] == 0 && d < n; ++d) {
      const bool has_below = i + d < n && counts[i + d] != 0,
                 has_above = i >= d && counts[i - d] != 0;
      if (!has_below && !has_above) continue;
      strength[i] = slices[has_below ? i + d : i - d].strength_N;
      break;
    }
  }
  for (std::size_t i = 0; i < n; ++i) {
    const std::size_t a = i > 0 ? i - 1 : 0, b = i + 1 < n ? i + 1 : n - 1;
    const auto [top_N, bottom_N] =
        strength_ends(strength[i], strength[a], slices[i].depth_m - slices[a].depth_m, strength[b],
                      slices[b].depth_m - slices[i].depth_m, slabs[i].bottom_m - slabs[i].top_m);
    slabs[i].strength_top_N = top_N;
    slabs[i].strength_bottom_N = bottom_N;
  }
  for (const BodyShell& shell : shells)
    insert(shell, slabs);
  return slabs;
}

}  // namespace trocar::runtime
