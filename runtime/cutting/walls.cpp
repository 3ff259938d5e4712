// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "runtime/cutting/potential.h"
#include "runtime/cutting/yield_spring.h"

namespace trocar::runtime {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector2d;
using Eigen::Vector3d;

// Sums over the Gauss points of forces and stiffnesses, each times a power of the distance t from
// the tip along the shaft: all that the derivatives by the proxy's six coordinates are made of.
class WallSums {
 public:
  double energy = 0;

  void add_force(double t, const Vector2d& force) noexcept {
    force_[0] += force;
    force_[1] += t * force;
  }
  void add_in_all_directions(double t, double k) noexcept {
    k_[0] += k;
    k_[1] += t * k;
    k_[2] += t * t * k;
  }
  // `k` times the products of the unit vector's coordinates.
  void add_along(double t, double k, const Vector2d& unit) noexcept {
    const Vector2d scaled = k * unit, squares = scaled.cwiseProduct(unit);
    const double mixed = scaled.x() * unit.y(), t2 = t * t;
    squares_[0] += squares;
    squares_[1] += t * squares;
    squares_[2] += t2 * squares;
    mixed_[0] += mixed;
    mixed_[1] += t * mixed;
    mixed_[2] += t2 * mixed;
  }

  const Vector2d& force(std::size_t power) const noexcept { return force_[power]; }
  Eigen::Matrix2d stiffness(std::size_t power) const noexcept {
    const Vector2d& squares = squares_[power];
    Eigen::Matrix2d H;
    H << k_[power] + squares.x(), mixed_[power], mixed_[power], k_[power] + squares.y();
    return H;
  }

 private:
  std::array<double, 3> k_{}, mixed_{};
  std::array<Vector2d, 2> force_{Vector2d::Zero(), Vector2d::Zero()};
  std::array<Vector2d, 3> squares_{Vector2d::Zero(), Vector2d::Zero(), Vector2d::Zero()};
};

}  // namespace

// A crossing moves by N' (u + turn x (lever + t axis)).
void add_walls(const Tick& tick, const Vector3d& tip, const Vector3d& axis, const Vector3d& lever,
               bool majorise, Evaluation& e) noexcept {
  e.wall_J = 0;
  e.walls_yield = false;
  if (tick.state.hole < 0) return;
  const CuttingHole& hole = tick.hole_in_use();
  const double per_z = -1 / axis.z(), mx = axis.x(), my = axis.y();
  WallSums sums;
  for (int i = tick.state.embedded_from; i < tick.state.embedded_to; ++i) {
    const CuttingHoleSlab& s = hole.slabs[static_cast<std::size_t>(i)];
    const double k = s.wall_N_per_m;
    if (k <= 0) continue;
    const double elastic_m = s.wall_most_N / k;
    for (std::size_t g = 0; g < kWallPoints; ++g) {
      const double t = (s.depth_m[g] + tip.z()) * per_z;
      const Slot& wall = s.walls[g];
      const Slot::Offset d = wall.offset({tip.x() + t * mx, tip.y() + t * my});
      const double d2 = d.x_m * d.x_m + d.y_m * d.y_m, clearance = wall.clearance_m();
      // A femtometre has no direction that could be computed.
      if (d2 <= std::max(clearance * clearance, 1e-30)) continue;
      if (clearance <= 0 && d2 <= elastic_m * elastic_m) {  // most ticks: no square root
        sums.energy += 0.5 * k * d2;
        sums.add_force(t, k * Vector2d(d.x_m, d.y_m));
        if (d.beside_corner) {
          sums.add_in_all_directions(t, k);
        } else {
          const double per = k / d2;
          sums.add_along(t, per, {d.x_m, d.y_m});
        }
      } else {
        const double whole = std::sqrt(d2), distance = whole - clearance;
        const YieldSpring h = yield_spring(k, s.wall_most_N, distance, majorise);
        e.walls_yield = e.walls_yield || distance > elastic_m;
        sums.energy += h.energy;
        const Vector2d unit(d.x_m / whole, d.y_m / whole);
        sums.add_force(t, h.force * unit);
        const double across = d.beside_corner ? h.across * distance / whole : 0;
        sums.add_in_all_directions(t, across);
        const double more = h.along - across;
        sums.add_along(t, more, unit);
      }
    }
  }
  e.wall_J = sums.energy;
  if (sums.energy <= 0) return;
  Eigen::Matrix<double, 3, 2> N, C0, C1;
  N << 1, 0, 0, 1, mx * per_z, my * per_z;
  for (int c = 0; c < 2; ++c) {
    const Vector3d n = N.col(c);
    C0.col(c) = lever.cross(n);
    C1.col(c) = axis.cross(n);
  }
  const Vector2d g0 = sums.force(0), g1 = sums.force(1);
  const Eigen::Matrix2d H0 = sums.stiffness(0), H1 = sums.stiffness(1), H2 = sums.stiffness(2);
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
