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

inline SoftLayer soft_layer(double top_m, double bottom_m, double stiffness_N_per_m,
                            double stiffening_N_per_m2, double puncture_N, double cutting_N,
                            double friction_N_per_m = 0) {
  SoftLayer layer;
  layer.top_m = top_m;
  layer.bottom_m = bottom_m;
  layer.stiffness_N_per_m = stiffness_N_per_m;
  layer.stiffening_N_per_m2 = stiffening_N_per_m2;
  layer.puncture_N = puncture_N;
  layer.cutting_N = cutting_N;
  layer.friction_N_per_m = friction_N_per_m;
  return layer;
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

  /// The shaft's friction and walls in every slab.
  void hold_shaft(double friction_N_per_m, double wall_N_per_m2, double wall_strength_N_per_m,
                  double clearance_m = 0) {
    for (CuttingSlab& slab : slabs) {
      slab.friction_N_per_m = friction_N_per_m;
      slab.wall_N_per_m2 = wall_N_per_m2;
      slab.wall_strength_N_per_m = wall_strength_N_per_m;
      slab.clearance_m = clearance_m;
    }
  }
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
  /// Upright on the z axis, from one depth to the other.
  template <class Each>
  void push(double from_m, double to_m, double step_m, Each each) {
    move(plate_at(0, from_m), plate_at(0, to_m), step_m, each);
  }
  void push(double from_m, double to_m, double step_m) {
    move(plate_at(0, from_m), plate_at(0, to_m), step_m);
  }
  /// The largest force on the tip on the way.
  double peak_N(const Pose& from, const Pose& to, double step_m) {
    double most_N = 0;
    move(from, to, step_m, [&](const CuttingResult& result, const Pose&) {
      most_N = std::max(most_N, result.tip_N);
    });
    return most_N;
  }
};

}  // namespace trocar::runtime
