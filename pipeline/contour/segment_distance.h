// SPDX-License-Identifier: GPL-3.0-or-later
// Distances between points and segments in floating point, in the unit of the coordinates.
#pragma once

#include <algorithm>

#include "formats/geometry/lattice.h"

namespace trocar::pipeline {

struct Point {
  double x = 0, y = 0;
};

inline Point point(LatticePoint p) {
  return {static_cast<double>(p.x), static_cast<double>(p.y)};
}

inline double distance2_between(Point a, Point b) {
  return (a.x - b.x) * (a.x - b.x) + (a.y - b.y) * (a.y - b.y);
}

/// Finds the point of the segment ab that is nearest to p. Returns it as a fraction of the way from
/// a to b.
inline double fraction_along(Point a, Point b, Point p) {
  const double abx = b.x - a.x, aby = b.y - a.y;
  const double length2 = abx * abx + aby * aby;
  if (length2 == 0) return 0;
  return std::clamp(((p.x - a.x) * abx + (p.y - a.y) * aby) / length2, 0.0, 1.0);
}

/// Squared distance from p to the segment ab. It is exactly zero if a, b and p are lattice points
/// and p lies on the segment.
inline double segment_distance2(Point a, Point b, Point p) {
  const double abx = b.x - a.x, aby = b.y - a.y, apx = p.x - a.x, apy = p.y - a.y;
  const double length2 = abx * abx + aby * aby, along = apx * abx + apy * aby;
  if (along <= 0 || length2 == 0) return apx * apx + apy * apy;
  if (along >= length2) return distance2_between(b, p);
  const double cross = abx * apy - aby * apx;
  return cross * cross / length2;
}

}  // namespace trocar::pipeline
