// SPDX-License-Identifier: Apache-2.0
// The slot of a hole: the region of one horizontal plane in which the tool's axis can be without
// the shaft pressing on the hole's wall. The region is the convex hull of at most kMaxCorners
// points, the corners, widened on all sides by the clearance (the gap between shaft and wall). The
// region can only grow, so that pushing the wall aside always costs energy. (A region that moved
// with the tool would close again behind the tool.)
//
// Contract (tests/runtime/bone_cutting/law/slot_test.cpp):
//  1. reach(p).distance_m is the distance of p from the convex hull of the corners, minus the
//     clearance, but at least 0.
//  2. include(p) extends the region so that it contains p, unless p is less than a femtometre away
//     from it. The hull gets one more corner, which lies between p and the hull at the distance of
//     the clearance from p. Without clearance the result is the convex hull of the region and p. If
//     the hull then has more than kMaxCorners corners, one edge is removed by extending its two
//     neighbours until they intersect. The removed edge is the one whose removal adds the least
//     area to the hull. include() never increases the distance of any point from the region.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cstdint>

namespace trocar::runtime {

class Slot {
 public:
  static constexpr int kMaxCorners = 8;

  /// Sets the region to the disc around `at_m` whose radius is the clearance.
  void open(const Eigen::Vector2d& at_m, double clearance_m) noexcept;
  bool is_open() const noexcept { return size_ > 0; }
  void close() noexcept { size_ = 0; }

  /// Position of a point relative to the region.
  struct Reach {
    double distance_m = 0;
    Eigen::Vector2d away =
        Eigen::Vector2d::Zero();  ///< unit vector away from the region; zero inside
    /// Consider the curve of constant distance_m that passes through the point. `bend` is
    /// distance_m divided by the curve's radius of curvature: 1 next to a corner without clearance,
    /// and 0 next to an edge. `bend` is also the second derivative of distance_m^2 / 2 in the
    /// direction perpendicular to `away`.
    double bend = 0;
  };
  /// Returns the position of `p_m` relative to the region (contract 1).
  Reach reach(const Eigen::Vector2d& p_m) const noexcept;

  /// Vector from the nearest point of the hull to a point. The clearance is not subtracted. For a
  /// point inside the hull the vector is zero.
  struct Offset {
    double x_m = 0, y_m = 0;
    bool beside_corner = false;  ///< the nearest point of the hull is a corner
  };
  /// Returns the offset of `p_m`. To save time, the search starts at the edge or corner that was
  /// nearest to the previous point.
  Offset offset(const Eigen::Vector2d& p_m) const noexcept {
    if (size_ == 1) return {p_m.x() - corners_[0].x(), p_m.y() - corners_[0].y(), true};
    if (size_ == 2) {
      const Eigen::Vector2d edge = corners_[1] - corners_[0], to = p_m - corners_[0];
      const double along = to.dot(edge) / edge.squaredNorm();
      // If rounding has merged both corners, `along` is 0 / 0. This order of min and max gives 0.
      const double part = std::min(1.0, std::max(0.0, along));
      return {to.x() - part * edge.x(), to.y() - part * edge.y(), part != along};
    }
    if ((p_m - middle_m_).squaredNorm() < disc_m_ * disc_m_) return {};
    return offset_of_many(p_m);
  }

  /// Checks whether one and the same corner or edge of the hull is nearest to all points within
  /// `reach_m` of `p_m`. If so, calls corner(offset) or edge(offset, edge, squared length of the
  /// edge), and returns the result of that call. Here `offset` is the vector from the corner or
  /// edge to `p_m`, and `edge` is the vector along the edge. If all the points are inside the hull,
  /// returns true without a call. Returns false if no single corner or edge is nearest to all
  /// the points. A hull with more than two corners is checked only at the edge or corner where
  /// the search of offset() would start; if this does not decide the question, the function
  /// returns false, too.
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

  /// Extends the region (contract 2).
  void include(const Eigen::Vector2d& p_m) noexcept;

  int corners() const noexcept { return size_; }
  const Eigen::Vector2d& corner(int i) const noexcept {
    return corners_[static_cast<std::size_t>(i)];
  }

 private:
  Offset offset_of_many(const Eigen::Vector2d& p_m) const noexcept;
  /// Result of nearest_of_many(). kInside: all points are inside the hull. kCorner, kEdge: this
  /// corner or edge is nearest to all points. kSeveral: several parts are nearest, or the search
  /// could not decide.
  struct Nearest {
    enum { kInside, kCorner, kEdge, kSeveral } part = kSeveral;
    Eigen::Vector2d offset_m = Eigen::Vector2d::Zero(), edge_m = Eigen::Vector2d::Zero();
  };
  Nearest nearest_of_many(const Eigen::Vector2d& p_m, double reach_m) const noexcept;
  void find_disc() noexcept;

  // The members are ordered so that a slot with one or two corners uses a single cache line.
  int size_ = 0;
  // Edge nearest to the previous point. If a corner was nearest: the edge that begins there.
  mutable int last_edge_ = 0;
  double clearance_m_ = 0;
  Eigen::Vector2d middle_m_ = Eigen::Vector2d::Zero();
  double disc_m_ = 0;  // radius of a disc around middle_m_ that lies inside the hull
  std::array<Eigen::Vector2d, kMaxCorners> corners_;  // counter-clockwise
};

}  // namespace trocar::runtime
