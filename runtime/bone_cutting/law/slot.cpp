// SPDX-License-Identifier: Apache-2.0
#include "runtime/bone_cutting/law/slot.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace trocar::runtime {
namespace {

/// Points nearer to the region than this do not extend it. So no edge is shorter, and no quotient by
/// the square of an edge's length overflows. A femtometre is far below what could be felt.
constexpr double kLeastEdge_m = 1e-15;
constexpr double kFlat = 1e-13;  // radians: more than rounding errors, less than could be felt

double cross(const Eigen::Vector2d& a, const Eigen::Vector2d& b) noexcept {
  return a.x() * b.y() - a.y() * b.x();
}

// Andrew's monotone chain (1979). Sorts `points`, and returns the size of `hull`. A corner that is
// straight within rounding is left out: the sign of its cross product is random, so the hull would
// not be convex.
template <std::size_t N>
int hull_of(std::array<Eigen::Vector2d, N>& points, int count,
            std::array<Eigen::Vector2d, 2 * N>& hull) noexcept {
  const auto is_before = [](const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
    return a.x() < b.x() || (a.x() == b.x() && a.y() < b.y());
  };
  for (int i = 1; i < count; ++i) {
    const Eigen::Vector2d p = points[i];
    int k = i;
    for (; k > 0 && is_before(p, points[k - 1]); --k)
      points[k] = points[k - 1];
    points[k] = p;
  }
  int size = 0;
  const auto add = [&](const Eigen::Vector2d& p, int least) {
    while (size >= least) {
      const Eigen::Vector2d last = hull[size - 1] - hull[size - 2], next = p - hull[size - 2];
      if (cross(last, next) > kFlat * last.norm() * next.norm()) break;
      --size;
    }
    hull[size++] = p;
  };
  for (int i = 0; i < count; ++i)
    add(points[i], 2);
  for (int i = count - 2, least = size + 1; i >= 0; --i)
    add(points[i], least);
  return size > 1 ? size - 1 : size;
}

}  // namespace

void Slot::open(const Eigen::Vector2d& at_m, double clearance_m) noexcept {
  corners_[0] = at_m;
  size_ = 1;
  last_edge_ = 0;
  clearance_m_ = clearance_m;
  disc_m_ = 0;
}

void Slot::find_disc() noexcept {
  last_edge_ = 0;
  disc_m_ = 0;
  if (size_ < 3) return;
  middle_m_.setZero();
  for (int i = 0; i < size_; ++i)
    middle_m_ += corners_[i];
  middle_m_ /= size_;
  double radius = std::numeric_limits<double>::infinity();
  for (int i = 0; i < size_; ++i) {
    const Eigen::Vector2d edge = corners_[(i + 1) % size_] - corners_[i];
    radius = std::min(radius, cross(edge, middle_m_ - corners_[i]) / edge.norm());
  }
  // The factor 0.99 keeps the disc inside in spite of rounding.
  disc_m_ = 0.99 * std::max(radius, 0.0);
}

Slot::Offset Slot::offset_of_many(const Eigen::Vector2d& p_m) const noexcept {
  if (size_ == 0) return {};
  const auto beside = [&](int i, const Eigen::Vector2d& to, const Eigen::Vector2d& edge,
                          double along, double length2) -> Offset {
    last_edge_ = i;
    const Eigen::Vector2d from = to - edge * (along / length2);
    return {from.x(), from.y(), false};
  };
  // Outside a convex polygon, the strips beside the edges and the sectors beside the corners do not
  // overlap. The edge or corner that was nearest last time is still nearest if the point lies in
  // its strip or sector.
  {
    const int i = last_edge_;
    const Eigen::Vector2d& a = corners_[i];
    const Eigen::Vector2d edge = corners_[i + 1 < size_ ? i + 1 : 0] - a, to = p_m - a;
    const double along = to.dot(edge), length2 = edge.squaredNorm();
    if (along > 0 && along < length2) {
      if (cross(edge, to) < 0) return beside(i, to, edge, along, length2);
    } else if (along <= 0 && to.dot(a - corners_[i > 0 ? i - 1 : size_ - 1]) >= 0) {
      return {to.x(), to.y(), true};
    }
  }
  // Search all corners and edges. A point counts as inside only if it is inside by more than
  // rounding. Next to a region that is almost a line, the signs are random, but the distance from
  // the region is still accurate.
  constexpr double kRounding = 1e-12;
  bool within = true;
  double best2 = std::numeric_limits<double>::infinity();
  Offset best;
  for (int i = 0; i < size_; ++i) {
    const Eigen::Vector2d& a = corners_[i];
    const Eigen::Vector2d edge = corners_[i + 1 < size_ ? i + 1 : 0] - a, to = p_m - a;
    const double along = to.dot(edge), length2 = edge.squaredNorm(), across = cross(edge, to);
    within = within && across > 0 &&
             across * across > kRounding * kRounding * length2 * to.squaredNorm();
    const bool beside_edge = along > 0 && along < length2;
    if (along >= length2) continue;  // the next corner is nearer
    const Eigen::Vector2d from = beside_edge ? Eigen::Vector2d(to - edge * (along / length2)) : to;
    const double d2 = from.squaredNorm();
    if (d2 < best2) {
      best2 = d2;
      last_edge_ = i;
      best = {from.x(), from.y(), !beside_edge};
    }
  }
  return within ? Offset{} : best;
}

Slot::Nearest Slot::nearest_of_many(const Eigen::Vector2d& p_m, double reach_m) const noexcept {
  const double inside_m = disc_m_ - reach_m;
  if (size_ == 0 || (inside_m > 0 && (p_m - middle_m_).squaredNorm() < inside_m * inside_m))
    return {.part = Nearest::kInside};
  const auto exceeds_reach = [&](double product, double length2) {
    return product > 0 && product * product >= reach_m * reach_m * length2;
  };
  const int i = last_edge_;
  const Eigen::Vector2d& a = corners_[i];
  const Eigen::Vector2d edge = corners_[i + 1 < size_ ? i + 1 : 0] - a, to = p_m - a;
  const double along = to.dot(edge), length2 = edge.squaredNorm();
  if (exceeds_reach(along, length2) && exceeds_reach(length2 - along, length2) &&
      exceeds_reach(-cross(edge, to), length2))
    return {Nearest::kEdge, to - (along / length2) * edge, edge};
  const Eigen::Vector2d before = a - corners_[i > 0 ? i - 1 : size_ - 1];
  if (exceeds_reach(-along, length2) && exceeds_reach(to.dot(before), before.squaredNorm()))
    return {.part = Nearest::kCorner, .offset_m = to};
  return {};
}

Slot::Reach Slot::reach(const Eigen::Vector2d& p_m) const noexcept {
  if (size_ == 0) return {};
  const Offset from = offset(p_m);
  const double whole = std::hypot(from.x_m, from.y_m);
  Reach out;
  if (whole <= clearance_m_) return out;
  out.distance_m = whole - clearance_m_;
  out.away = Eigen::Vector2d(from.x_m, from.y_m) / whole;
  out.bend = from.beside_corner ? out.distance_m / whole : 0;
  return out;
}

void Slot::include(const Eigen::Vector2d& p_m) noexcept {
  const Reach r = reach(p_m);
  if (!(r.distance_m > kLeastEdge_m)) return;
  constexpr std::size_t kMax = kMaxCorners + 1;
  std::array<Eigen::Vector2d, kMax> points;
  std::copy(corners_.begin(), corners_.begin() + size_, points.begin());
  points[size_] = p_m - clearance_m_ * r.away;
  std::array<Eigen::Vector2d, 2 * kMax> hull;
  int size = hull_of(points, size_ + 1, hull);
  while (size > kMaxCorners) {
    // Remove the edge whose removal adds the least area: extend its two neighbours until they meet.
    int best = -1;
    double least = std::numeric_limits<double>::infinity();
    Eigen::Vector2d meeting = Eigen::Vector2d::Zero();
    for (int i = 0; i < size; ++i) {
      const Eigen::Vector2d &a = hull[i], &b = hull[(i + 1) % size];
      const Eigen::Vector2d before = a - hull[(i + size - 1) % size],
                            after = hull[(i + 2) % size] - b;
      const double turn = cross(before, after);
      if (turn <= 10 * kFlat * before.norm() * after.norm()) continue;
      const double t = cross(b - a, after) / turn;
      const Eigen::Vector2d at = a + t * before;
      const double added = 0.5 * std::abs(cross(at - a, b - a));
      if (added < least) least = added, best = i, meeting = at;
    }
    int gone = (best + 1) % size;
    if (best < 0) {
      // The hull is almost flat: remove the corner nearest to the chord between its neighbours.
      least = std::numeric_limits<double>::infinity();
      for (int i = 0; i < size; ++i) {
        const Eigen::Vector2d a = hull[(i + size - 1) % size], chord = hull[(i + 1) % size] - a;
        const double part = std::clamp((hull[i] - a).dot(chord) / chord.squaredNorm(), 0.0, 1.0);
        const double height = (hull[i] - a - part * chord).norm();
        if (height < least) least = height, gone = i;
      }
    } else {
      hull[best] = meeting;
    }
    for (int i = gone; i + 1 < size; ++i)
      hull[i] = hull[i + 1];
    --size;
  }
  size_ = std::min(size, kMaxCorners);
  std::copy(hull.begin(), hull.begin() + size_, corners_.begin());
  find_disc();
}

}  // namespace trocar::runtime
