// SPDX-License-Identifier: Apache-2.0
// Steiner points: lattice points inside the material at which refinement may insert a vertex. For a
// triangle that is too sharp or too large, the Steiner point is near the circumcentre, or nearer
// to the shortest edge, like the off-centres of Uengoer (2004).
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "formats/geometry/lattice.h"

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

}  // namespace trocar
