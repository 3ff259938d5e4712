// SPDX-License-Identifier: Apache-2.0
#include "runtime/haptics/bone/walls.h"

#include <cmath>
#include <limits>
#include <utility>

#include "runtime/haptics/bone/tick.h"

namespace trocar::runtime {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector2d;
using Eigen::Vector3d;

// The radius is at least kReachPerStep times the displacement of the shaft within a tick. At each
// new tick it shrinks by the factor kForgotten.
constexpr double kReachPerStep = 2, kForgotten = 0.9, kMinReach_m = 1e-9;

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

double length_at(const StiffeningSpring& spring, double force) noexcept {
  if (!(spring.soft < spring.stiff) || !(force > spring.knee))
    return force / std::max(spring.soft < spring.stiff ? spring.soft : spring.stiff, 1e-300);
  const double scale = spring.knee / spring.soft, turn = spring.stiff * scale;
  const double length = scale * (1 + std::log(std::min(force, turn) / spring.knee));
  return length + std::max(0.0, force - turn) / spring.stiff;
}

StiffeningForce stiffening_force(const StiffeningSpring& spring, double most,
                                 double length) noexcept {
  const bool is_linear = !(spring.soft < spring.stiff);
  const double soft = is_linear ? spring.stiff : spring.soft;
  // `scale`: length at the knee; `turn`: force at which the spring becomes linear again.
  const double scale = is_linear ? 0 : spring.knee / soft, turn = spring.stiff * scale;
  const auto energy_at = [&](double r, double force) {
    if (is_linear || force <= spring.knee) return 0.5 * force * r;
    const double to = std::min(force, turn);
    const double curved = 0.5 * spring.knee * scale + scale * (to - spring.knee);
    return curved + 0.5 * (force * force - to * to) / spring.stiff;
  };
  double force = soft * length, along = soft;
  if (!is_linear && length > scale) {
    force = spring.knee * std::exp(length / scale - 1);
    along = force / scale;
    if (!(force < turn)) {
      force = turn + spring.stiff * (length - scale * (1 + std::log(turn / spring.knee)));
      along = spring.stiff;
    }
  }
  if (force <= most)
    return {energy_at(length, force),           force,        along,
            length > 0 ? force / length : soft, spring.stiff, false};
  const double yield = length_at(spring, most);
  return {energy_at(yield, most) + most * (length - yield), most, 0, most / length,
          most / (length - yield + most / spring.stiff),    true};
}

WallSums WallModel::at(const Tick& tick, const ShaftLine& line) noexcept {
  double& reach_m = tick.state.wall_radius_m;
  if (is_known_) {
    const ShaftLine by{line.at_m - line_.at_m, line.per_depth - line_.per_depth};
    // The largest displacement of the axis is at one end of the hole.
    const double step_m = std::sqrt(
        std::max(by.crossing(top_m_).squaredNorm(), by.crossing(bottom_m_).squaredNorm()));
    reach_m = std::max(reach_m, kReachPerStep * step_m);
    if (step_m < reach_m_) return sums_.moved(by);
  } else {
    reach_m = std::max(kForgotten * reach_m, kMinReach_m);
  }
  learn(tick, line);
  return sums_;
}

void WallModel::learn(const Tick& tick, const ShaftLine& line) noexcept {
  const CuttingHole& hole = tick.hole_in_use();
  const double reach_m = tick.state.wall_radius_m;
  WallSums sums;
  std::size_t others = 0;
  double top_m = 0, bottom_m = 0;
  bool is_first = true;
  for (int i = tick.state.embedded_from; i < tick.state.embedded_to; ++i) {
    const CuttingHoleSlab& s = hole.slabs[static_cast<std::size_t>(i)];
    const double k = s.wall_N_per_m;
    if (k <= 0) continue;
    if (std::exchange(is_first, false)) top_m = s.depth_m.front();
    bottom_m = s.depth_m.back();
    const double elastic_m = s.wall_most_N / k - reach_m;
    const double elastic2_m2 = elastic_m > 0 ? elastic_m * elastic_m : -1;
    for (std::size_t g = 0; g < tick.options.wall_points; ++g) {
      const double depth = s.depth_m[g];
      const Slot& wall = s.walls[g];
      const auto add = [&](const Vector2d& offset, auto&& add_stiffness) {
        const double d2 = offset.squaredNorm(), clear_m = wall.clearance_m();
        // If there is clearance, the energy is quadratic only inside the clearance, where
        // it is zero.
        if (clear_m > 0) return clear_m > reach_m && d2 < (clear_m - reach_m) * (clear_m - reach_m);
        if (d2 > elastic2_m2) return false;
        sums.energy_J += 0.5 * k * d2;
        sums.add_force(depth, k * offset);
        add_stiffness();
        return true;
      };
      const bool is_quadratic = wall.nearest(
          line.crossing(depth), reach_m,
          [&](const Vector2d& offset) {
            return add(offset, [&] { sums.add_in_all_directions(depth, k); });
          },
          [&](const Vector2d& offset, const Vector2d& edge, double edge2) {
            return add(offset, [&] { sums.add_along(depth, k / edge2, {-edge.y(), edge.x()}); });
          });
      if (!is_quadratic)
        tick.state.wall_points[others++] =
            static_cast<std::uint32_t>(kMaxWallPoints * static_cast<std::size_t>(i) + g);
    }
  }
  is_known_ = true;
  line_ = line;
  reach_m_ = reach_m;
  top_m_ = top_m;
  bottom_m_ = bottom_m;
  sums_ = sums;
  others_ = others;
}

// If the proxy moves by the translation u and the rotation w, the crossing at the distance t from
// the tip moves by N^T (u + w x (lever + t axis)).
void add_walls(const Tick& tick, const Vector3d& tip, const Vector3d& axis, const Vector3d& lever,
               bool majorise, Evaluation& e) noexcept {
  e.wall_J = 0;
  e.walls_yield = false;
  if (tick.state.hole < 0) return;
  const CuttingHole& hole = tick.hole_in_use();
  const double per_z = -1 / axis.z(), mx = axis.x(), my = axis.y();
  const Vector2d per_depth(per_z * mx, per_z * my);
  const ShaftLine line{tip.head<2>() + tip.z() * per_depth, per_depth};
  WallSums sums = tick.walls.at(tick, line);
  for (std::size_t at = 0; at < tick.walls.others(); ++at) {
    const std::size_t point = tick.state.wall_points[at], g = point % kMaxWallPoints;
    const CuttingHoleSlab& s = hole.slabs[point / kMaxWallPoints];
    const double k = s.wall_N_per_m, elastic_m = s.wall_most_N / k, depth = s.depth_m[g];
    const Slot& wall = s.walls[g];
    const Slot::Offset d = wall.offset(line.crossing(depth));
    const double d2 = d.x_m * d.x_m + d.y_m * d.y_m, clearance = wall.clearance_m();
    // Below a femtometre the direction of the offset cannot be computed.
    if (d2 <= std::max(clearance * clearance, 1e-30)) continue;
    const double whole = std::sqrt(d2), distance = whole - clearance;
    const YieldSpring h = yield_spring(k, s.wall_most_N, distance, majorise);
    e.walls_yield = e.walls_yield || distance > elastic_m;
    sums.energy_J += h.energy;
    const Vector2d unit(d.x_m / whole, d.y_m / whole);
    sums.add_force(depth, h.force * unit);
    const double across = d.beside_corner ? h.across * distance / whole : 0;
    sums.add_in_all_directions(depth, across);
    sums.add_along(depth, h.along - across, unit);
  }
  e.wall_J = sums.energy_J;
  Eigen::Matrix<double, 3, 2> N, C0, C1;
  N << 1, 0, 0, 1, mx * per_z, my * per_z;
  for (int c = 0; c < 2; ++c) {
    const Vector3d n = N.col(c);
    C0.col(c) = lever.cross(n);
    C1.col(c) = axis.cross(n);
  }
  // Convert powers of the depth to powers of t = (tip.z + depth) per_z, the distance from the tip.
  const double t0 = tip.z() * per_z;
  const Vector2d g0 = sums.force(0), g1 = t0 * g0 + per_z * sums.force(1);
  const Eigen::Matrix2d H0 = sums.stiffness(0), S1 = per_z * sums.stiffness(1), H1 = t0 * H0 + S1,
                        H2 = t0 * (H1 + S1) + per_z * per_z * sums.stiffness(2);
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
