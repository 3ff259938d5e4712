// SPDX-License-Identifier: Apache-2.0
// Where the tool's axis may be in one plane of its hole without pressing on the wall: a convex
// region that only widens, so that pushing the wall aside can only cost energy. (A region that
// moved with the tool would close again behind it.)
//
// Contract (tests/runtime/cutting/slot_test.cpp):
//  1. reach().distance_m is that to the convex hull of the corners, less the clearance, at least 0.
//  2. include(p) gives a region that has p and all that it had: no distance grows. It is the hull
//  of
//     both unless the corners are used up; then the hull's shortest edge is cut off by its
//     neighbours' lines, which only adds to it.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>

namespace trocar::runtime {

class Slot {
 public:
  static constexpr int kMostCorners = 8;

  /// The region is `at_m` with all around it that is nearer than the clearance.
  void open(const Eigen::Vector2d& at_m, double clearance_m) noexcept;
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

  /// From the nearest point of the hull to `p_m`, the clearance not taken off: zero within. It
  /// looks first where the last point was.
  struct Offset {
    double x_m = 0, y_m = 0;
    bool beside_corner = false;
  };
  Offset offset(const Eigen::Vector2d& p_m) const noexcept {
    if (size_ == 1) return {p_m.x() - corners_[0].x(), p_m.y() - corners_[0].y(), true};
    if ((p_m - middle_m_).squaredNorm() <= disc2_m2_) return {};
    return offset_of_many(p_m);
  }
  double clearance_m() const noexcept { return clearance_m_; }

  /// Contract 2.
  void include(const Eigen::Vector2d& p_m) noexcept;

  int corners() const noexcept { return size_; }
  const Eigen::Vector2d& corner(int i) const noexcept {
    return corners_[static_cast<std::size_t>(i)];
  }

 private:
  Offset offset_of_many(const Eigen::Vector2d& p_m) const noexcept;
  void find_disc() noexcept;

  // What a slot of one corner needs comes first, in one line of the cache.
  int size_ = 0;
  mutable int last_edge_ = 0;  // the edge, or the corner it begins with, nearest to the last point
  double clearance_m_ = 0;
  Eigen::Vector2d middle_m_ = Eigen::Vector2d::Zero();
  double disc2_m2_ = -1;  // square of the radius of a disc around middle_m_ within the hull
  std::array<Eigen::Vector2d, kMostCorners> corners_;  // counter-clockwise
};

}  // namespace trocar::runtime
