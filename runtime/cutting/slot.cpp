// SPDX-License-Identifier: Apache-2.0
#include "runtime/cutting/slot.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace trocar::runtime {
namespace {

double cross(const Eigen::Vector2d& a, const Eigen::Vector2d& b) noexcept {
  return a.x() * b.y() - a.y() * b.x();
}

// Andrew's monotone chain (1979); `points` is sorted here. Returns the size of `hull`.
template <std::size_t N>
int hull_of(std::array<Eigen::Vector2d, N>& points, int count,
            std::array<Eigen::Vector2d, N + 1>& hull) noexcept {
  std::sort(points.begin(), points.begin() + count, [](const auto& a, const auto& b) {
    return a.x() < b.x() || (a.x() == b.x() && a.y() < b.y());
  });
  int size = 0;
  const auto add = [&](const Eigen::Vector2d& p, int least) {
    while (size >= least && cross(hull[size - 1] - hull[size - 2], p - hull[size - 2]) <= 0)
      --size;
    hull[size++] = p;
  };
  for (int i = 0; i < count; ++i)
    add(points[i], 2);
  for (int i = count - 2, least = size + 1; i >= 0; --i)
    add(points[i], least);
  return size > 1 ? size - 1 : size;
}

}  // namespace

Slot::Reach Slot::reach(const Eigen::Vector2d& p_m) const noexcept {
  if (size_ == 0) return {};
  // The nearest point of the hull: a corner, or inside an edge.
  Eigen::Vector2d nearest = corners_[0];
  double best2 = (p_m - corners_[0]).squaredNorm();
  bool at_corner = true, outside = size_ < 3;
  for (int i = 0; size_ > 1 && i < size_; ++i) {
    const Eigen::Vector2d& a = corners_[i];
    const Eigen::Vector2d edge = corners_[(i + 1) % size_] - a, to = p_m - a;
    if (size_ > 2 && cross(edge, to) < 0) outside = true;
    const double along = to.dot(edge), length2 = edge.squaredNorm();
    const bool inside_edge = along > 0 && along < length2;
    const Eigen::Vector2d q = inside_edge ? Eigen::Vector2d(a + edge * (along / length2)) : a;
    const double d2 = (p_m - q).squaredNorm();
    if (d2 < best2 || i == 0) {
      best2 = d2;
      nearest = q;
      at_corner = !inside_edge;
    }
  }
  Reach out;
  const double whole = std::sqrt(best2);
  if (!outside || whole <= clearance_m_) return out;
  out.distance_m = whole - clearance_m_;
  out.away = (p_m - nearest) / whole;
  out.bend = at_corner ? out.distance_m / whole : 0;
  return out;
}

void Slot::include(const Eigen::Vector2d& p_m) noexcept {
  const Reach r = reach(p_m);
  if (r.distance_m <= 0) return;
  constexpr std::size_t kMost = kMostCorners + 1;
  std::array<Eigen::Vector2d, kMost> points;
  std::copy(corners_.begin(), corners_.begin() + size_, points.begin());
  points[size_] = p_m - clearance_m_ * r.away;
  std::array<Eigen::Vector2d, kMost + 1> hull;
  int size = hull_of(points, size_ + 1, hull);
  while (size > kMostCorners) {
    // Cut off the edge whose removal adds least: its neighbours meet beyond it.
    int best = -1;
    double least = std::numeric_limits<double>::infinity();
    Eigen::Vector2d meeting = Eigen::Vector2d::Zero();
    for (int i = 0; i < size; ++i) {
      const Eigen::Vector2d &a = hull[i], &b = hull[(i + 1) % size];
      const Eigen::Vector2d before = a - hull[(i + size - 1) % size],
                            after = hull[(i + 2) % size] - b;
      const double turn = cross(before, after);
      if (turn <= 1e-9 * before.norm() * after.norm()) continue;
      const double t = cross(b - a, after) / turn;
      const Eigen::Vector2d at = a + t * before;
      const double added = 0.5 * std::abs(cross(at - a, b - a));
      if (added < least) least = added, best = i, meeting = at;
    }
    if (best < 0) break;  // not with more than four corners: the turns sum to a full one
    hull[best] = meeting;
    const int gone = (best + 1) % size;
    for (int i = gone; i + 1 < size; ++i)
      hull[i] = hull[i + 1];
    --size;
  }
  size_ = std::min(size, kMostCorners);
  std::copy(hull.begin(), hull.begin() + size_, corners_.begin());
}

}  // namespace trocar::runtime
