// SPDX-License-Identifier: Apache-2.0
// Working data of one tick of the cutting law. holes.h, front.h, potential.h and equilibrium.h operate on
// it, in that order (cutting_law.cpp).
// Tests: tests/runtime/bone_cutting/law/cutting_tick_test.cpp
#pragma once

#include <algorithm>

#include "runtime/bone_cutting/law/cutting_law.h"
#include "runtime/bone_cutting/law/walls.h"

namespace trocar::runtime {

struct Tick {
  const CuttingOptions& options;
  const Pose& plate;
  std::span<const CuttingSlab> slabs;
  CuttingState& state;
  std::span<const SoftLayer> layers;  ///< layers that have an entry in `state`

  /// The proxy's pose at the start of the tick, from which slides are measured. `axis` and `tip` belong to
  /// that pose, in {B}; `down` is the downward component of the axis.
  Pose start{};
  Eigen::Quaterniond back = Eigen::Quaterniond::Identity();
  Eigen::Vector3d axis = -Eigen::Vector3d::UnitZ(), tip = Eigen::Vector3d::Zero();
  double down = 1;

  int hole = -1;                          ///< hole that the tool is in or would enter; -1: none
  double front_m = 0, first_front_m = 0;  ///< depth of the front now and at the tick's start
  bool is_free = false;                   ///< the front has left all material
  double embedded_m = 0;                  ///< embedded length of the shaft in all slabs
  double friction_N = 0;                  ///< friction force at which the shaft slides
  double viscous_N_s_per_m = 0;           ///< viscous friction along the shaft
  double tip_friction_N = 0;  ///< friction force at which the tip slides across its axis
  mutable WallModel walls{};  ///< cache; forget() it when a wall changes

  void start_at(const Pose& X) noexcept {
    start = X;
    axis = X.q * options.tool.inward_plate;
    tip = X * options.tool.tip_plate_m;
    down = -axis.z();
    back = X.q.conjugate();
  }

  /// Removes the part of the tip's slip that is along the shaft or beyond its limit. This only lowers its
  /// energy.
  void limit_tip_slip() noexcept {
    Eigen::Vector3d& slip = state.tip_slip_m;
    slip -= axis * axis.dot(slip);
    const double length = slip.norm();
    if (length > options.tip_presliding_m) slip *= options.tip_presliding_m / length;
  }

  int slab_count() const noexcept { return static_cast<int>(slabs.size()); }
  const CuttingSlab& slab(int i) const noexcept { return slabs[static_cast<std::size_t>(i)]; }
  /// The first slab whose bottom is at this depth or below it.
  int slab_at(double depth_m) const noexcept {
    const auto at = std::lower_bound(slabs.begin(), slabs.end(), depth_m,
                                     [](const CuttingSlab& s, double d) { return s.bottom_m < d; });
    return static_cast<int>(at - slabs.begin());
  }
  CuttingHole& hole_in_use() const noexcept {
    return state.holes[static_cast<std::size_t>(state.hole)];
  }
};

/// Intersection of the line through the tip with the plane at a depth.
inline Eigen::Vector2d crossing(const Eigen::Vector3d& tip, const Eigen::Vector3d& axis,
                                double depth_m) noexcept {
  const double along = (-depth_m - tip.z()) / axis.z();
  return {tip.x() + along * axis.x(), tip.y() + along * axis.y()};
}

/// Depth of Gauss point `g` of a slab with this number of points, which have equal weights.
inline double gauss_depth(const CuttingSlab& slab, std::size_t g,
                          std::size_t points = kMaxWallPoints) noexcept {
  constexpr std::array<double, kMaxWallPoints> kGauss{0.21132486540518713, 0.78867513459481287};
  const double part = points == 1 ? 0.5 : kGauss[g];
  return slab.top_m + part * (slab.bottom_m - slab.top_m);
}

}  // namespace trocar::runtime
