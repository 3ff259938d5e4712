// SPDX-License-Identifier: Apache-2.0
// Sums the forces and stiffnesses of the walls of the hole that the tool is in. Each slab has Gauss
// points at which the wall acts, and each Gauss point has a slot (slot.h), which is the region in
// which the shaft's axis does not press on the wall. While the shaft stays close to a reference
// position, the nearest corner or edge of most slots stays the same. If this is so at a Gauss
// point, and if the wall does not yield there, the energy of the point is a quadratic function of
// the shaft's displacement. If the slot has a clearance, a point counts as quadratic only inside
// the clearance, where its energy is 0. The sum over all quadratic points is quadratic as well, and
// its coefficients are kept. Therefore usually only the first evaluation of a tick visits all
// points. Later evaluations visit only the few points whose energy is not quadratic.
//
// Contract (tests/runtime/bone_cutting/law/walls_test.cpp): add_walls() adds the sum over all
// Gauss points, quadratic or not. Apart from rounding, the sum does not depend on the poses of
// earlier evaluations.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>

namespace trocar::runtime {

struct Tick;
struct Evaluation;

/// The axis of the shaft. The axis crosses the horizontal plane at depth d in the point
/// at_m + d * per_depth.
struct ShaftLine {
  Eigen::Vector2d at_m = Eigen::Vector2d::Zero(), per_depth = Eigen::Vector2d::Zero();
  Eigen::Vector2d crossing(double depth_m) const noexcept { return at_m + depth_m * per_depth; }
};

/// Sums over Gauss points: the energy, and the forces and stiffnesses multiplied by powers of the
/// depth. add_walls() computes the derivatives with respect to the proxy's six coordinates from
/// these sums.
class WallSums {
 public:
  double energy_J = 0;

  void add_force(double depth_m, const Eigen::Vector2d& force_N) noexcept {
    force_[0] += force_N;
    force_[1] += depth_m * force_N;
  }
  /// Adds a stiffness k that is the same in all horizontal directions.
  void add_in_all_directions(double depth_m, double k) noexcept {
    k_[0] += k;
    k_[1] += depth_m * k;
    k_[2] += depth_m * depth_m * k;
  }
  /// Adds the stiffness matrix k v v^T. If v is a unit vector, this is a spring k along v.
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
  /// Returns the sums after the shaft has moved by `by`, assuming that the stiffness of every point
  /// stays constant.
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

  /// Sum of the forces, each multiplied by its depth to the power of 0 or 1.
  const Eigen::Vector2d& force(std::size_t power) const noexcept { return force_[power]; }
  /// Sum of the stiffnesses, each multiplied by its depth to the power of 0, 1 or 2.
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

/// Cached sums over the quadratic points. A point is quadratic if its energy is a quadratic
/// function while the shaft stays within a radius of the position that the shaft had at the last
/// visit of all points. The radius, CuttingState::wall_radius_m, is adapted to the motion of the
/// shaft in a tick. With a larger radius fewer points are quadratic. With a smaller radius all
/// points are visited more often.
class WallModel {
 public:
  /// Empties the cache. Call this when a wall has changed.
  void forget() noexcept { is_known_ = false; }
  /// Returns the sums over the quadratic points for the shaft at `line`. Afterwards the first
  /// others() entries of CuttingState::wall_points list the points that are not in the sums. Gauss
  /// point g of slab i is listed as kMaxWallPoints * i + g.
  WallSums at(const Tick& tick, const ShaftLine& line) noexcept;
  std::size_t others() const noexcept { return others_; }

 private:
  void learn(const Tick& tick, const ShaftLine& line) noexcept;

  bool is_known_ = false;
  ShaftLine line_;
  // reach_m_: the radius for which the sums hold. top_m_, bottom_m_: depths of the first and the
  // last point.
  double reach_m_ = 0, top_m_ = 0, bottom_m_ = 0;
  WallSums sums_;
  std::size_t others_ = 0;
};

/// Adds the walls to the energy and its derivatives in `e`. `lever`: vector from the plate's origin
/// to the tip. `majorise`: as for evaluate() (potential.h).
void add_walls(const Tick& tick, const Eigen::Vector3d& tip, const Eigen::Vector3d& axis,
               const Eigen::Vector3d& lever, bool majorise, Evaluation& e) noexcept;

}  // namespace trocar::runtime
