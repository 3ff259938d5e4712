// SPDX-License-Identifier: Apache-2.0
#include "runtime/bone_cutting/law/walls.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "runtime/bone_cutting/law/potential.h"
#include "runtime/bone_cutting/law/yield_spring.h"

namespace trocar::runtime {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector2d;
using Eigen::Vector3d;

// The radius is at least kReachPerStep times the displacement of the shaft within a tick. At each
// new tick it shrinks by the factor kForgotten.
constexpr double kReachPerStep = 2, kForgotten = 0.9, kMinReach_m = 1e-9;

}  // namespace

WallSums WallModel::at(const Tick& tick, const ShaftLine& line) noexcept {
  double& reach_m = tick.state.wall_radius_m;
  if (is_known_) {
    const ShaftLine by{line.at_m - line_.at_m, line.per_depth - line_.per_depth};
    // The largest displacement of the axis is at one end of the hole.
    const double step_m = std::sqrt(
        std::max(by.crossing(top_m_).squaredNorm(), by.crossing(bottom_m_).squaredNorm()));
    reach_m = std::max(reach_m, kReachPerStep * step_m);
    if (step_m < reach_m_) return sums_.moved(by);
  } else {
    reach_m = std::max(kForgotten * reach_m, kMinReach_m);
  }
  learn(tick, line);
  return sums_;
}

void WallModel::learn(const Tick& tick, const ShaftLine& line) noexcept {
  const CuttingHole& hole = tick.hole_in_use();
  const double reach_m = tick.state.wall_radius_m;
  WallSums sums;
  std::size_t others = 0;
  double top_m = 0, bottom_m = 0;
  bool is_first = true;
  for (int i = tick.state.embedded_from; i < tick.state.embedded_to; ++i) {
    const CuttingHoleSlab& s = hole.slabs[static_cast<std::size_t>(i)];
    const double k = s.wall_N_per_m;
    if (k <= 0) continue;
    if (std::exchange(is_first, false)) top_m = s.depth_m.front();
    bottom_m = s.depth_m.back();
    const double elastic_m = s.wall_most_N / k - reach_m;
    const double elastic2_m2 = elastic_m > 0 ? elastic_m * elastic_m : -1;
    for (std::size_t g = 0; g < tick.options.wall_points; ++g) {
      const double depth = s.depth_m[g];
      const Slot& wall = s.walls[g];
      const auto add = [&](const Vector2d& offset, auto&& add_stiffness) {
        const double d2 = offset.squaredNorm(), clear_m = wall.clearance_m();
        // If there is clearance, the energy is quadratic only inside the clearance, where
        // it is zero.
        if (clear_m > 0) return clear_m > reach_m && d2 < (clear_m - reach_m) * (clear_m - reach_m);
        if (d2 > elastic2_m2) return false;
        sums.energy_J += 0.5 * k * d2;
        sums.add_force(depth, k * offset);
        add_stiffness();
        return true;
      };
      const bool is_quadratic = wall.nearest(
          line.crossing(depth), reach_m,
          [&](const Vector2d& offset) {
            return add(offset, [&] { sums.add_in_all_directions(depth, k); });
          },
          [&](const Vector2d& offset, const Vector2d& edge, double edge2) {
            return add(offset, [&] { sums.add_along(depth, k / edge2, {-edge.y(), edge.x()}); });
          });
      if (!is_quadratic)
        tick.state.wall_points[others++] =
            static_cast<std::uint32_t>(kMaxWallPoints * static_cast<std::size_t>(i) + g);
    }
  }
  is_known_ = true;
  line_ = line;
  reach_m_ = reach_m;
  top_m_ = top_m;
  bottom_m_ = bottom_m;
  sums_ = sums;
  others_ = others;
}

// If the proxy moves by the translation u and the rotation w, the crossing at the distance t from
// the tip moves by N^T (u + w x (lever + t axis)).
void add_walls(const Tick& tick, const Vector3d& tip, const Vector3d& axis, const Vector3d& lever,
               bool majorise, Evaluation& e) noexcept {
  e.wall_J = 0;
  e.walls_yield = false;
  if (tick.state.hole < 0) return;
  const CuttingHole& hole = tick.hole_in_use();
  const double per_z = -1 / axis.z(), mx = axis.x(), my = axis.y();
  const Vector2d per_depth(per_z * mx, per_z * my);
  const ShaftLine line{tip.head<2>() + tip.z() * per_depth, per_depth};
  WallSums sums = tick.walls.at(tick, line);
  for (std::size_t at = 0; at < tick.walls.others(); ++at) {
    const std::size_t point = tick.state.wall_points[at], g = point % kMaxWallPoints;
    const CuttingHoleSlab& s = hole.slabs[point / kMaxWallPoints];
    const double k = s.wall_N_per_m, elastic_m = s.wall_most_N / k, depth = s.depth_m[g];
    const Slot& wall = s.walls[g];
    const Slot::Offset d = wall.offset(line.crossing(depth));
    const double d2 = d.x_m * d.x_m + d.y_m * d.y_m, clearance = wall.clearance_m();
    // Below a femtometre the direction of the offset cannot be computed.
    if (d2 <= std::max(clearance * clearance, 1e-30)) continue;
    const double whole = std::sqrt(d2), distance = whole - clearance;
    const YieldSpring h = yield_spring(k, s.wall_most_N, distance, majorise);
    e.walls_yield = e.walls_yield || distance > elastic_m;
    sums.energy_J += h.energy;
    const Vector2d unit(d.x_m / whole, d.y_m / whole);
    sums.add_force(depth, h.force * unit);
    const double across = d.beside_corner ? h.across * distance / whole : 0;
    sums.add_in_all_directions(depth, across);
    sums.add_along(depth, h.along - across, unit);
  }
  e.wall_J = sums.energy_J;
  Eigen::Matrix<double, 3, 2> N, C0, C1;
  N << 1, 0, 0, 1, mx * per_z, my * per_z;
  for (int c = 0; c < 2; ++c) {
    const Vector3d n = N.col(c);
    C0.col(c) = lever.cross(n);
    C1.col(c) = axis.cross(n);
  }
  // Convert powers of the depth to powers of t = (tip.z + depth) per_z, the distance from the tip.
  const double t0 = tip.z() * per_z;
  const Vector2d g0 = sums.force(0), g1 = t0 * g0 + per_z * sums.force(1);
  const Eigen::Matrix2d H0 = sums.stiffness(0), S1 = per_z * sums.stiffness(1), H1 = t0 * H0 + S1,
                        H2 = t0 * (H1 + S1) + per_z * per_z * sums.stiffness(2);
  e.g.head<3>() += N * g0;
  e.g.tail<3>() += C0 * g0 + C1 * g1;
  const Eigen::Matrix<double, 3, 2> NH0 = N * H0, NH1 = N * H1, CH0 = C0 * H0 + C1 * H1,
                                    CH1 = C0 * H1 + C1 * H2;
  e.H.topLeftCorner<3, 3>() += NH0 * N.transpose();
  const Matrix3d mixed = NH0 * C0.transpose() + NH1 * C1.transpose();
  e.H.topRightCorner<3, 3>() += mixed;
  e.H.bottomLeftCorner<3, 3>() += mixed.transpose();
  e.H.bottomRightCorner<3, 3>() += CH0 * C0.transpose() + CH1 * C1.transpose();
}

}  // namespace trocar::runtime
