// SPDX-License-Identifier: Apache-2.0
// Steiner points: lattice points inside the material at which refinement may insert a vertex. For a
// triangle that is too sharp or too large, the Steiner point is near the circumcentre, or nearer
// to the shortest edge, like the off-centres of Uengoer (2004).
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <optional>

#include "formats/mesh/lattice.h"
#include "formats/mesh/predicates.h"

namespace trocar {

/// A position relative to the midpoint of an edge, in units of the edge's length: `along` in the
/// direction of the edge, `away` to the left of the edge.
struct EdgeOffset {
  double along, away;
};

// Positions are computed and rounded relative to a nearby vertex, so that a mesh does not depend on
// the position of its outline in the plane. A mesh must not depend on the outline's rotation by
// right angles either. Therefore use round_half_up() only in a plane in canonical orientation
// (canonical_rotation.h); round_half_away() may be used in any orientation.

/// The lattice point nearest to p + (x, y). A coordinate that is half-way between two lattice
/// coordinates is rounded up. The result is clamped to the lattice's bounds. (For speed, GCC's and
/// clang's vector types compute both coordinates together, and std::floor is avoided.)
inline LatticePoint round_half_up(LatticePoint p, double x, double y) noexcept {
  using Two = double __attribute__((vector_size(16)));
  using TwoWhole = std::int32_t __attribute__((vector_size(8)));
  using TwoMasks = std::int64_t __attribute__((vector_size(16)));
  constexpr double kMax = kMaxCoordinate;
  const Two origin{static_cast<double>(p.x), static_cast<double>(p.y)}, half{0.5, 0.5};
  const Two low = -kMax - origin, high = kMax + half - origin;
  Two up = Two{x, y} + half;
  up = up < low ? low : up;
  up = up > high ? high : up;
  const TwoWhole whole = __builtin_convertvector(up, TwoWhole);
  const TwoMasks is_above = __builtin_convertvector(whole, Two) > up;
  return {p.x + whole[0] + static_cast<std::int32_t>(is_above[0]),
          p.y + whole[1] + static_cast<std::int32_t>(is_above[1])};
}

/// The lattice point nearest to p + (x, y). An x or y that is half-way between two whole numbers is
/// rounded away from 0. Precondition: the result is within the lattice's bounds.
inline LatticePoint round_half_away(LatticePoint p, double x, double y) noexcept {
  return {p.x + static_cast<std::int32_t>(std::lround(x)),
          p.y + static_cast<std::int32_t>(std::lround(y))};
}

/// The position that `offset` describes for the edge pq, rounded to the lattice by round_half_up().
inline LatticePoint point_over(LatticePoint p, LatticePoint q, EdgeOffset offset) noexcept {
  const double dx = static_cast<double>(q.x) - p.x, dy = static_cast<double>(q.y) - p.y;
  return round_half_up(p, 0.5 * dx + (offset.along * dx - offset.away * dy),
                       0.5 * dy + (offset.along * dy + offset.away * dx));
}

/// The circumcentre of the triangle pqr, rounded by round_half_up(). The circumcentre lies on the
/// perpendicular bisector of pq. If it lies to the left of pq and farther from pq than `max_away`
/// times the length of pq, the result is the point of the bisector to the left of pq at this
/// largest distance. To the right of pq the distance is not limited. Precondition: pqr is
/// counter-clockwise.
inline LatticePoint centre_over(LatticePoint p, LatticePoint q, LatticePoint r,
                                double max_away) noexcept {
  const double qx = static_cast<double>(q.x) - p.x, qy = static_cast<double>(q.y) - p.y;
  const double rx = static_cast<double>(r.x) - p.x, ry = static_cast<double>(r.y) - p.y;
  // The centre lies on the bisector. Its distance from pq, in units of the length of pq, is half
  // the cotangent of the angle at r.
  const double cross = qx * ry - qy * rx, dot = rx * (rx - qx) + ry * (ry - qy);
  const double away = std::min(0.5 * dot / cross, max_away);
  return round_half_up(p, 0.5 * qx - away * qy, 0.5 * qy + away * qx);
}

/// A circle through the ends of an edge of length 1. Seen from any point of the circle on the left
/// of the edge, the edge subtends a given angle.
struct AngleCircle {
  double radius = 0;
  double centre = 0;  ///< distance of the circle's centre from the edge; > 0: left of the edge

  AngleCircle() = default;
  explicit AngleCircle(double angle_rad)
      : radius(0.5 / std::sin(angle_rad)), centre(radius * std::cos(angle_rad)) {}

  /// Distance of the off-centre from the edge. The off-centre is the point of the circle that is
  /// farthest from the edge; it lies on the edge's bisector.
  double off_centre_distance() const noexcept { return centre + radius; }
  /// The point of the circle at an angle from the off-centre, measured at the circle's centre. A
  /// positive angle leads in the direction of the edge. `sine` and `cosine` are those of the angle.
  EdgeOffset at(double sine, double cosine) const noexcept {
    return {radius * sine, centre + radius * cosine};
  }
};

/// Factor below 1 by which to multiply the distance of a Steiner point from an edge. Rounding to
/// the lattice may move the point away from the edge, and the triangle's angle at the point would
/// then be too small. The factor makes up for the rounding. `length` is the edge's length in steps.
inline double rounding_allowance(double length) noexcept {
  constexpr double kSteps = 1.5;
  return 1 - std::min(0.4, kSteps / length);
}

// Lattice points at which refinement may split a boundary edge. Near an acute corner of the outline
// the split points lie on shells, which are concentric circles around the corner. So both edges
// that meet at the corner are split at equal distances from the corner, and the parts of one edge
// do not encroach (predicates.h) upon the parts of the other (Ruppert, 1995).

/// A corner of the outline has shells if its angle in the material is below this angle.
inline constexpr double kAcuteCorner_deg = 75, kAcuteCorner_cos = 0.25881904510252074;
/// Two points are on the same shell if their distances from the corner differ by at most this many
/// steps.
inline constexpr double kSameShell_steps = 2;

/// The four lattice points around the wanted split point, numbered 0 to 3. The wanted point lies at
/// a fraction of the way from a to b. For each of the four points, the class stores on which side
/// of ab the point lies and how far the point is from the wanted point. The code does not branch on
/// the side, because a processor cannot predict the side.
class SplitCell {
 public:
  /// Precondition: a and b are on the lattice, and `fraction` is from 0 to 1.
  SplitCell(LatticePoint a, LatticePoint b, double fraction) noexcept {
    const std::int64_t dx = std::int64_t{b.x} - a.x, dy = std::int64_t{b.y} - a.y;
    const double x = fraction * static_cast<double>(dx), y = fraction * static_cast<double>(dy);
    const std::int64_t low_x = floor_of(x), low_y = floor_of(y);
    const double left = x - static_cast<double>(low_x), right = 1 - left,
                 below = y - static_cast<double>(low_y), above = 1 - below;
    low_ = {static_cast<std::int32_t>(a.x + low_x), static_cast<std::int32_t>(a.y + low_y)};
    const std::int64_t side = dx * low_y - dy * low_x;
    sides_ = {side, side + dx, side - dy, side - dy + dx};
    distances2_ = {left * left + below * below, left * left + above * above,
                   right * right + below * below, right * right + above * above};
  }

  /// A point is inside if it lies on ab or on the left of ab, and outside if it lies strictly on
  /// the right of ab. nearest_inside() returns the number of that inside point which is nearest to
  /// the wanted point. If there is no inside point, the number is that of a point on the other side
  /// or of an excluded point. So check the number with is_inside().
  std::size_t nearest_inside() const noexcept {
    constexpr std::array kPenalty{0.0, kFar};
    std::array<double, 4> far{};
    for (std::size_t k = 0; k < 4; ++k)
      far[k] = distances2_[k] + kPenalty[static_cast<std::size_t>(sides_[k] < 0)];
    return least(far);
  }
  /// Returns the number of the point that has side(k) nearest to `wanted`. Excluded points come
  /// last, so check the result with is_excluded().
  std::size_t nearest_side(std::int64_t wanted) const noexcept {
    std::array<std::uint64_t, 4> far{};
    for (std::size_t k = 0; k < 4; ++k)
      far[k] = static_cast<std::uint64_t>(std::abs(sides_[k] - wanted)) |
               static_cast<std::uint64_t>(is_excluded(k)) << 63;
    return least(far);
  }
  bool is_inside(std::size_t k) const noexcept { return sides_[k] >= 0 && !is_excluded(k); }
  bool is_excluded(std::size_t k) const noexcept { return distances2_[k] >= kFar; }
  /// Makes nearest_inside() and nearest_side() prefer the other points to point k.
  void exclude(std::size_t k) noexcept { distances2_[k] = 2 * kFar; }
  LatticePoint point(std::size_t k) const noexcept {
    return {low_.x + static_cast<std::int32_t>(k / 2), low_.y + static_cast<std::int32_t>(k % 2)};
  }
  /// Twice the signed area of the triangle of a, b and point k.
  std::int64_t side(std::size_t k) const noexcept { return sides_[k]; }

 private:
  static constexpr double kFar = 4;
  // The index of the smallest value. If several values are equally small, the first one counts.
  template <typename Value>
  static std::size_t least(const std::array<Value, 4>& values) noexcept {
    const std::size_t low = values[1] < values[0] ? 1 : 0, high = values[3] < values[2] ? 3 : 2;
    return values[high] < values[low] ? high : low;
  }
  // std::floor() of a number within the lattice's bounds, without a function call.
  static std::int64_t floor_of(double x) noexcept {
    const auto whole = static_cast<std::int64_t>(x);
    return whole - static_cast<std::int64_t>(static_cast<double>(whole) > x);
  }

  LatticePoint low_;
  std::array<std::int64_t, 4> sides_;
  std::array<double, 4> distances2_;
};

/// Returns a lattice point at which the edge ab of the triangle abc may be split. Of the four
/// lattice points around the position at `fraction` of the way from a to b, the function considers
/// those that may_split() allows, and returns the one nearest to this position. Returns
/// std::nullopt if may_split() allows none of the four.
inline std::optional<LatticePoint> split_near(LatticePoint a, LatticePoint b, LatticePoint c,
                                              double fraction) noexcept {
  SplitCell cell(a, b, fraction);
  while (true) {
    const std::size_t k = cell.nearest_inside();
    if (!cell.is_inside(k)) return std::nullopt;
    if (may_split(a, b, c, cell.point(k))) [[likely]]
      return cell.point(k);
    cell.exclude(k);
  }
}

/// The wanted position of a split on an edge ab.
struct SplitAim {
  double fraction;  ///< 0 at a, 1 at b
  /// True if the split point shall lie on a shell around a, or around b. At most one is true.
  bool on_shell_of_a, on_shell_of_b;
};

/// Considers the lattice points that lie exactly on ab, without a and b, and returns the one
/// nearest to the aim. Returns std::nullopt if there are no such points.
std::optional<LatticePoint> split_on_edge(LatticePoint a, LatticePoint b, SplitAim aim) noexcept;

/// Returns a lattice point near the aim, less than a step from the edge ab of the triangle abc, at
/// which this edge may be split (may_split()). If there are several such points and the aim has a
/// shell, the result is the point nearest to the shell. If the aim has no shell, the result is the
/// point nearest to the edge. (If the aim is the midpoint, this point is at most half a step from
/// the edge.) Returns std::nullopt if there is no such point.
std::optional<LatticePoint> split_beside_edge(LatticePoint a, LatticePoint b, LatticePoint c,
                                              SplitAim aim) noexcept;

}  // namespace trocar
