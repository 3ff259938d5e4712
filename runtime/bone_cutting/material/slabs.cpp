// SPDX-License-Identifier: Apache-2.0
#include "runtime/bone_cutting/material/slabs.h"

#include <algorithm>
#include <cmath>

namespace trocar::runtime {
namespace {

// A slab's ends exceed its own and its neighbour's strength by at most this fraction of its own.
constexpr double kBeyondNeighbours = 0.05;

}  // namespace

std::array<double, 2> strength_ends(double strength_N, double above_N, double above_gap_m,
                                    double below_N, double below_gap_m,
                                    double thickness_m) noexcept {
  if (!(above_gap_m > 0 && below_gap_m > 0)) return {strength_N, strength_N};
  // A slab's mean is its slice's also where the slice is not in its middle.
  const double line_N = (below_N - above_N) / (above_gap_m + below_gap_m) * thickness_m / 2,
               beyond_N = kBeyondNeighbours * strength_N;
  const auto limited = [&](double end_N, double neighbour_N) {
    return std::clamp(end_N, std::max(0.0, std::min(strength_N, neighbour_N) - beyond_N),
                      std::max(strength_N, neighbour_N) + beyond_N) -
           strength_N;
  };
  const double down_N = limited(strength_N + line_N, below_N),
               up_N = -limited(strength_N - line_N, above_N);
  const double change_N = std::abs(down_N) < std::abs(up_N) ? down_N : up_N;
  return {strength_N - change_N, strength_N + change_N};
}

}  // namespace trocar::runtime
