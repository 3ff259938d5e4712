// SPDX-License-Identifier: Apache-2.0
// Where the tool's axis may be in one plane of its hole without pressing on the wall: a convex
// region that only widens, so that pushing the wall aside can only cost energy. (A region that moved
// with the tool would close again behind it.)
//
// Contract (tests/runtime/cutting/slot_test.cpp):
//  1. distance() is that to the convex hull of the corners, less the clearance, at least 0.
//  2. include(p) gives a region that has p and all that it had: no distance grows. It is the hull of
//     both unless the corners are used up; then the hull's shortest edge is cut off by its
//     neighbours' lines, which only adds to it.
#pragma once

#include <Eigen/Core>
#include <array>

namespace trocar::runtime {

class Slot {
 public:
  static constexpr int kMostCorners = 8;

  /// The region is `at_m` with all around it that is nearer than the clearance.
  void open(const Eigen::Vector2d& at_m, double clearance_m) noexcept {
    corners_[0] = at_m;
    size_ = 1;
    clearance_m_ = clearance_m;
  }
  bool is_open() const noexcept { return size_ > 0; }
  void close() noexcept { size_ = 0; }

  /// How far a point is outside.
  struct Reach {
    double distance_m = 0;
    Eigen::Vector2d away = Eigen::Vector2d::Zero();  ///< unit, from the region; zero within
    /// Distance over the radius of curvature of the equidistant there: 1 beside a corner without
    /// clearance, 0 beside an edge. It is the second derivative of distance^2 / 2 across `away`.
    double bend = 0;
  };
  Reach reach(const Eigen::Vector2d& p_m) const noexcept;

  /// Contract 2.
  void include(const Eigen::Vector2d& p_m) noexcept;

  int corners() const noexcept { return size_; }
  const Eigen::Vector2d& corner(int i) const noexcept { return corners_[static_cast<std::size_t>(i)]; }

 private:
  std::array<Eigen::Vector2d, kMostCorners> corners_;  // counter-clockwise
  int size_ = 0;
  double clearance_m_ = 0;
};

}  // namespace trocar::runtime
