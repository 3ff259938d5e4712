// SPDX-License-Identifier: Apache-2.0
// Bodies and motions for the tests of the cutting law.
#pragma once

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "runtime/haptics/bone/cutting_law.h"

namespace trocar::runtime {

/// The plate upright, or tilted about y, with its origin at a depth.
inline Pose plate_at(double x_m, double depth_m, double tilt = 0) {
  Pose T;
  T.p_m = {x_m, 0, -depth_m};
  T.q = from_rotation_vector({0, tilt, 0});
  return T;
}

inline std::vector<CuttingSlab> even_slabs(int count, double thickness_m, double strength_N) {
  std::vector<CuttingSlab> slabs(static_cast<std::size_t>(count));
  for (int i = 0; i < count; ++i) {
    CuttingSlab& slab = slabs[static_cast<std::size_t>(i)];
    slab.top_m = i * thickness_m;
    slab.bottom_m = (i + 1) * thickness_m;
    slab.strength_top_N = slab.strength_bottom_N = strength_N;
  }
  return slabs;
}

/// A body, a tool and what they remember; the tip is the plate's origin unless the tool says else.
struct Bench {
  CuttingOptions options;
  std::vector<CuttingSlab> slabs;
  CuttingState state;
  CuttingResult out;
  double cut_J = 0;

  explicit Bench(std::vector<CuttingSlab> body, std::size_t holes = 4)
      : slabs(std::move(body)), state(make_cutting_state(slabs.size(), holes)) {}

  const CuttingResult& tick(const Pose& plate) {
    cutting_tick(options, plate, slabs, state, out);
    cut_J += out.cut_J;
    return out;
  }
  /// The plate moves from one place to the other in steps of at most `step_m`; calls `each(out)`.
  template <class Each>
  void move(const Pose& from, const Pose& to, double step_m, Each each) {
    if (!state.has_begun) tick(from);
    const Twist d = displacement(from, to);
    const int steps = std::max(1, static_cast<int>(std::lround(d.head<3>().norm() / step_m)));
    for (int k = 1; k <= steps; ++k) {
      const double part = static_cast<double>(k) / steps;
      Pose X{from.p_m + part * d.head<3>(), from_rotation_vector(part * d.tail<3>()) * from.q};
      each(tick(X), X);
    }
  }
  void move(const Pose& from, const Pose& to, double step_m) {
    move(from, to, step_m, [](const CuttingResult&, const Pose&) {});
  }
};

}  // namespace trocar::runtime
