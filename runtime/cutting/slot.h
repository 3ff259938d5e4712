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
#include <algorithm>
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
    if (size_ == 2) {
      const Eigen::Vector2d edge = corners_[1] - corners_[0], to = p_m - corners_[0];
      const double along = to.dot(edge) / edge.squaredNorm();
      // In this order: corners that rounding has made one give 0 / 0, which is to count as 0.
      const double share = std::min(1.0, std::max(0.0, along));
      return {to.x() - share * edge.x(), to.y() - share * edge.y(), share != along};
    }
    if ((p_m - middle_m_).squaredNorm() < disc_m_ * disc_m_) return {};
    return offset_of_many(p_m);
  }

  /// Tells what of the hull is nearest to all points within `reach_m` of `p_m`, by its offset from
  /// there to `p_m`: corner(offset), edge(offset, edge, its length squared), whose answer it gives,
  /// or nothing and true where all those points are inside. False if several parts are nearest, or
  /// if it would have to search.
  template <class Corner, class Edge>
  bool nearest(const Eigen::Vector2d& p_m, double reach_m, Corner&& corner,
               Edge&& edge) const noexcept {
    if (size_ == 1) return corner(p_m - corners_[0]);
    if (size_ == 2) {
      const Eigen::Vector2d to = p_m - corners_[0], side = corners_[1] - corners_[0];
      const double along = to.dot(side), length2 = side.squaredNorm(), beyond = along - length2,
                   reach2 = reach_m * reach_m * length2;
      if (along * along < reach2 || beyond * beyond < reach2) return false;
      if (along <= 0) return corner(to);
      if (beyond >= 0) return corner(to - side);
      return edge(to - (along / length2) * side, side, length2);
    }
    const Nearest n = nearest_of_many(p_m, reach_m);
    if (n.part == Nearest::kCorner) return corner(n.offset_m);
    if (n.part == Nearest::kEdge) return edge(n.offset_m, n.edge_m, n.edge_m.squaredNorm());
    return n.part == Nearest::kInside;
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
  /// Looks only where the last point was.
  struct Nearest {
    enum { kInside, kCorner, kEdge, kSeveral } part = kSeveral;
    Eigen::Vector2d offset_m = Eigen::Vector2d::Zero(), edge_m = Eigen::Vector2d::Zero();
  };
  Nearest nearest_of_many(const Eigen::Vector2d& p_m, double reach_m) const noexcept;
  void find_disc() noexcept;

  // What a slot of one corner or two needs comes first.
  int size_ = 0;
  mutable int last_edge_ = 0;  // the edge, or the corner it begins with, nearest to the last point
  double clearance_m_ = 0;
  Eigen::Vector2d middle_m_ = Eigen::Vector2d::Zero();
  double disc_m_ = 0;  // radius of a disc around middle_m_ within the hull
  std::array<Eigen::Vector2d, kMostCorners> corners_;  // counter-clockwise
};

}  // namespace trocar::runtime
