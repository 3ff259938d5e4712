// SPDX-License-Identifier: Apache-2.0
// The force on the hand and the height of the tip since a session began, for pages that connect
// later. If there are more than kMaxPoints points, one point of each pair of successive points is
// removed: the point with the smaller force, so that peaks stay.
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

namespace trocar::runtime {

class ForceHistory {
 public:
  struct Point {
    double t_s = 0, force_N = 0, tip_z_m = 0;
  };
  static constexpr std::size_t kMaxPoints = 4000;

  void clear() { *this = {}; }
  /// Adds a point. A point that is not later than the previous one is ignored.
  void add(const Point& point);
  const std::vector<Point>& points() const noexcept { return points_; }

 private:
  std::vector<Point> points_;
  double last_t_s_ = -1;
  int every_ = 1;                 ///< one point is kept for this many added points
  int pending_ = 0;               ///< points added since a point was kept
  std::optional<Point> largest_;  ///< pending point with the largest force
};

}  // namespace trocar::runtime
