// SPDX-License-Identifier: GPL-3.0-or-later
// The places on the lattice where refinement may put a point.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <optional>

#include "formats/geometry/lattice.h"

namespace trocar::pipeline {

/// Seen from the middle of a side, in units of its length: along it and away from it.
struct Place {
  double along, away;
};

/// The lattice coordinate nearest to `away` steps from another; of two the upper one. What lies
/// beyond the lattice's bounds comes back on them. Places are measured from a vertex near by, and
/// ties go one way everywhere: so a mesh does not depend on where its outline lies. (std::floor is
/// a call.)
inline std::int32_t beside(std::int32_t from, double away) {
  const double up = std::clamp(away, -2.0 * kMaxCoordinate, 2.0 * kMaxCoordinate) + 0.5;
  const auto whole = static_cast<std::int32_t>(up);
  const std::int64_t at = std::int64_t{from} + whole - (whole > up ? 1 : 0);
  return static_cast<std::int32_t>(std::clamp<std::int64_t>(at, -kMaxCoordinate, kMaxCoordinate));
}

/// The lattice point nearest to a place on the left of the side pq.
inline LatticePoint over(LatticePoint p, LatticePoint q, Place place) {
  const double dx = static_cast<double>(q.x) - p.x, dy = static_cast<double>(q.y) - p.y;
  return {beside(p.x, 0.5 * dx + (place.along * dx - place.away * dy)),
          beside(p.y, 0.5 * dy + (place.along * dy + place.away * dx))};
}

/// How much nearer to a side of this length (squared) a place is to be, for rounding to the lattice
/// not to make the angle under which it sees the side too small.
inline double rounding_allowance(double side2) {
  constexpr double kSteps = 1.5;
  return 1 - std::min(0.4, kSteps / std::sqrt(side2));
}

/// Places over the shortest side of a triangle that see it under the wanted angle.
class PlacesUnderAngle {
 public:
  explicit PlacesUnderAngle(double angle_deg) {
    const double angle = angle_deg * std::numbers::pi / 180;
    const double radius = 0.5 / std::sin(angle);
    centre_ = radius * std::cos(angle);
    off_centre_ = centre_ + radius;
    for (std::size_t k = 0; k < aside_.size(); ++k) {
      const double turn = kTurns_deg[k] * std::numbers::pi / 180;
      aside_[k] = {radius * std::sin(turn), centre_ + radius * std::cos(turn)};
    }
  }

  /// The off-centre (Uengoer): on the bisector, in units of the side's length.
  double off_centre() const { return off_centre_; }
  /// Places turned from it.
  const auto& aside() const { return aside_; }

 private:
  static constexpr std::array kTurns_deg = {30.0, -30.0, 60.0, -60.0};
  double centre_, off_centre_;
  std::array<Place, kTurns_deg.size()> aside_{};
};

/// The triangle's circumcentre, or the place `most_away` (in units of pq) on the bisector of pq
/// where that is nearer.
inline LatticePoint centre_over(LatticePoint p, LatticePoint q, LatticePoint r, double most_away) {
  const double qx = static_cast<double>(q.x) - p.x, qy = static_cast<double>(q.y) - p.y;
  const double rx = static_cast<double>(r.x) - p.x, ry = static_cast<double>(r.y) - p.y;
  // The centre lies on the bisector, this far away: half the cotangent of the angle at r.
  const double cross = qx * ry - qy * rx, dot = rx * (rx - qx) + ry * (ry - qy);
  const double away = std::min(0.5 * dot / cross, most_away);
  return {beside(p.x, 0.5 * qx - away * qy), beside(p.y, 0.5 * qy + away * qx)};
}

/// The lattice point nearest to the point at this fraction from a to b, among the four around it,
/// that lies on the side ab of a triangle abc or on its inner side and leaves two positive
/// triangles. The boundary then never moves outwards, so it cannot meet another part of itself, and
/// the triangle that held it still does.
inline std::optional<LatticePoint> split_point(LatticePoint a, LatticePoint b, LatticePoint c,
                                               double fraction) {
  const double x = fraction * (static_cast<double>(b.x) - a.x),
               y = fraction * (static_cast<double>(b.y) - a.y);
  const auto is_allowed = [&](LatticePoint m) {
    return orient2d(a, b, m) >= 0 && orient2d(b, c, m) > 0 && orient2d(c, a, m) > 0;
  };
  const LatticePoint near{beside(a.x, x), beside(a.y, y)};
  if (is_allowed(near)) return near;
  const double off_x = x - (static_cast<double>(near.x) - a.x),
               off_y = y - (static_cast<double>(near.y) - a.y);
  const LatticePoint beside_x{near.x + (off_x < 0 ? -1 : 1), near.y},
      beside_y{near.x, near.y + (off_y < 0 ? -1 : 1)};
  const bool x_first = std::abs(off_x) > std::abs(off_y);
  if (const LatticePoint m = x_first ? beside_x : beside_y; is_allowed(m)) return m;
  if (const LatticePoint m = x_first ? beside_y : beside_x; is_allowed(m)) return m;
  if (const LatticePoint m{beside_x.x, beside_y.y}; is_allowed(m)) return m;
  return std::nullopt;
}

}  // namespace trocar::pipeline
