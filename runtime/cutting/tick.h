// SPDX-License-Identifier: Apache-2.0
// What the parts of one tick of the cutting law share: holes.h, front.h, potential.h and
// equilibrium.h work on it, in that order (cutting_law.cpp).
#pragma once

#include <algorithm>

#include "runtime/cutting/cutting_law.h"
#include "runtime/cutting/walls.h"

namespace trocar::runtime {

struct Tick {
  const CuttingOptions& options;
  const Pose& plate;
  std::span<const CuttingSlab> slabs;
  CuttingState& state;
  std::span<const SoftLayer> layers;  ///< of which `state` has an entry

  /// The proxy's pose from which slides are measured, along the shaft's direction there: at the
  /// tick's start; `axis` and `tip` in {B}, `down` the part of the axis that goes down.
  Pose start{};
  Eigen::Quaterniond back = Eigen::Quaterniond::Identity();
  Eigen::Vector3d axis = -Eigen::Vector3d::UnitZ(), tip = Eigen::Vector3d::Zero();
  double down = 1;

  int hole = -1;                          ///< that the tool is in, or would enter; -1: none
  double front_m = 0, first_front_m = 0;  ///< depth of the front now and at the tick's start
  bool is_free = false;                   ///< the front has come to where no material is
  double embedded_m = 0;                  ///< of the shaft, in all slabs
  double friction_N = 0;                  ///< at which the shaft slides
  double viscous_N_s_per_m = 0;           ///< along the shaft
  double tip_friction_N = 0;              ///< at which the tip slides across its axis
  mutable WallModel walls{};              ///< to be forgotten when a wall changes

  void start_at(const Pose& X) noexcept {
    start = X;
    axis = X.q * options.tool.inward_plate;
    tip = X * options.tool.tip_plate_m;
    down = -axis.z();
    back = X.q.conjugate();
  }

  /// The tip's slip, without what is along the shaft and beyond its limit; shorter is less energy.
  void limit_tip_slip() noexcept {
    Eigen::Vector3d& slip = state.tip_slip_m;
    slip -= axis * axis.dot(slip);
    const double length = slip.norm();
    if (length > options.tip_presliding_m) slip *= options.tip_presliding_m / length;
  }

  int slab_count() const noexcept { return static_cast<int>(slabs.size()); }
  const CuttingSlab& slab(int i) const noexcept { return slabs[static_cast<std::size_t>(i)]; }
  /// The first slab whose bottom is at a depth or below.
  int slab_at(double depth_m) const noexcept {
    const auto at = std::lower_bound(slabs.begin(), slabs.end(), depth_m,
                                     [](const CuttingSlab& s, double d) { return s.bottom_m < d; });
    return static_cast<int>(at - slabs.begin());
  }
  CuttingHole& hole_in_use() const noexcept {
    return state.holes[static_cast<std::size_t>(state.hole)];
  }
};

/// Where a line through the tip meets the plane at a depth.
inline Eigen::Vector2d crossing(const Eigen::Vector3d& tip, const Eigen::Vector3d& axis,
                                double depth_m) noexcept {
  const double along = (-depth_m - tip.z()) / axis.z();
  return {tip.x() + along * axis.x(), tip.y() + along * axis.y()};
}

/// Depth of one of a slab's Gauss points, which have equal weights.
inline double gauss_depth(const CuttingSlab& slab, std::size_t g) noexcept {
  static_assert(kWallPoints == 1 || kWallPoints == 2);
  constexpr std::array<double, 2> kGauss{0.21132486540518713, 0.78867513459481287};
  const double share = kWallPoints == 2 ? kGauss[g] : 0.5;
  return slab.top_m + share * (slab.bottom_m - slab.top_m);
}

}  // namespace trocar::runtime
