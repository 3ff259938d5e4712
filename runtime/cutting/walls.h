// SPDX-License-Identifier: Apache-2.0
// The walls of the hole that the tool is in, summed up over their Gauss points. As long as the
// shaft stays close to where it was, the same corner or edge of a point's slot is nearest, and if
// it does not yield, its energy is a quadratic function of the shaft's displacement. The sum of
// these is one as well, so that a tick goes through all points once and Newton's further steps
// through the few others.
//
// Contract (tests/runtime/cutting/walls_test.cpp): add_walls() adds the same, but for rounding, as
// the sum over all points one by one, whichever poses came before.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>

namespace trocar::runtime {

struct Tick;
struct Evaluation;

/// The shaft's axis: it crosses the plane at a depth in `at_m + depth * per_depth`.
struct ShaftLine {
  Eigen::Vector2d at_m = Eigen::Vector2d::Zero(), per_depth = Eigen::Vector2d::Zero();
  Eigen::Vector2d crossing(double depth_m) const noexcept { return at_m + depth_m * per_depth; }
};

/// Energies, and forces and stiffnesses times powers of the depth: all that the derivatives by the
/// proxy's six coordinates are made of.
class WallSums {
 public:
  double energy_J = 0;

  void add_force(double depth_m, const Eigen::Vector2d& force_N) noexcept {
    force_[0] += force_N;
    force_[1] += depth_m * force_N;
  }
  void add_in_all_directions(double depth_m, double k) noexcept {
    k_[0] += k;
    k_[1] += depth_m * k;
    k_[2] += depth_m * depth_m * k;
  }
  /// `k` times the products of the vector's coordinates.
  void add_along(double depth_m, double k, const Eigen::Vector2d& v) noexcept {
    const Eigen::Vector2d scaled = k * v, squares = scaled.cwiseProduct(v);
    const double mixed = scaled.x() * v.y(), depth2 = depth_m * depth_m;
    squares_[0] += squares;
    squares_[1] += depth_m * squares;
    squares_[2] += depth2 * squares;
    mixed_[0] += mixed;
    mixed_[1] += depth_m * mixed;
    mixed_[2] += depth2 * mixed;
  }
  /// The sums when the shaft has moved, of points whose stiffness is constant.
  WallSums moved(const ShaftLine& by) const noexcept {
    const Eigen::Matrix2d S1 = stiffness(1);
    const Eigen::Vector2d more = stiffness(0) * by.at_m + S1 * by.per_depth,
                          more_below = S1 * by.at_m + stiffness(2) * by.per_depth;
    WallSums out = *this;
    out.energy_J +=
        (force_[0] + 0.5 * more).dot(by.at_m) + (force_[1] + 0.5 * more_below).dot(by.per_depth);
    out.force_[0] += more;
    out.force_[1] += more_below;
    return out;
  }

  /// Times the depth to the power of 0 or 1.
  const Eigen::Vector2d& force(std::size_t power) const noexcept { return force_[power]; }
  /// Times the depth to the power of 0, 1 or 2.
  Eigen::Matrix2d stiffness(std::size_t power) const noexcept {
    const Eigen::Vector2d& squares = squares_[power];
    Eigen::Matrix2d S;
    S << k_[power] + squares.x(), mixed_[power], mixed_[power], k_[power] + squares.y();
    return S;
  }

 private:
  std::array<double, 3> k_{}, mixed_{};
  std::array<Eigen::Vector2d, 2> force_{Eigen::Vector2d::Zero(), Eigen::Vector2d::Zero()};
  std::array<Eigen::Vector2d, 3> squares_{Eigen::Vector2d::Zero(), Eigen::Vector2d::Zero(),
                                          Eigen::Vector2d::Zero()};
};

/// The points whose energy is quadratic within CuttingState::wall_reach_m of the shaft where it was
/// when they were last gone through. The reach follows how far the shaft moves in a tick: with a
/// longer one more points are others, beyond a shorter one all points are gone through again.
class WallModel {
 public:
  /// To be called when a wall has changed.
  void forget() noexcept { is_known_ = false; }
  /// The sums of these points with the shaft at `line`. The first others() entries of
  /// CuttingState::wall_points are then the other points: kWallPoints * slab + Gauss point.
  WallSums at(const Tick& tick, const ShaftLine& line) noexcept;
  std::size_t others() const noexcept { return others_; }

 private:
  void learn(const Tick& tick, const ShaftLine& line) noexcept;

  bool is_known_ = false;
  ShaftLine line_;
  double reach_m_ = 0, top_m_ = 0, bottom_m_ = 0;  // depths of the first point and of the last
  WallSums sums_;
  std::size_t others_ = 0;
};

/// Adds the walls to energy, gradient and second derivatives. `lever`: the tip from the plate's
/// origin.
void add_walls(const Tick& tick, const Eigen::Vector3d& tip, const Eigen::Vector3d& axis,
               const Eigen::Vector3d& lever, bool majorise, Evaluation& e) noexcept;

}  // namespace trocar::runtime
