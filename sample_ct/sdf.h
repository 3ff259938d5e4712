// SPDX-License-Identifier: Apache-2.0
// Signed distances of simple solids, in mm, negative inside.
//
// Laws (tests/sample_ct/phantom_test.cpp checks them for the whole vertebra):
//  1. every function f of the point is 1-Lipschitz, that is, |f(p) - f(q)| <= |p - q|,
//     so |f(p)| never exceeds the true distance to the surface;
//  2. f < 0 inside, f > 0 outside, f = 0 on the surface;
//  3. min, max, smooth_min and smooth_max keep law 1, because their gradient is a weighted mean of
//     the gradients of their arguments.
//
// Source: Inigo Quilez has collected the formulas at iquilezles.org in the articles "Distance
// functions" (also those of the round cone and the polygon) and "Smooth minimum".
#pragma once

#include <algorithm>
#include <cmath>
#include <span>

namespace trocar::sample {

struct Vec2 {
  double x = 0, y = 0;
};
struct Vec3 {
  double x = 0, y = 0, z = 0;
};

inline Vec2 operator+(Vec2 a, Vec2 b) {
  return {a.x + b.x, a.y + b.y};
}
inline Vec2 operator-(Vec2 a, Vec2 b) {
  return {a.x - b.x, a.y - b.y};
}
inline Vec2 operator*(double s, Vec2 a) {
  return {s * a.x, s * a.y};
}
inline double dot(Vec2 a, Vec2 b) {
  return a.x * b.x + a.y * b.y;
}
inline double cross(Vec2 a, Vec2 b) {
  return a.x * b.y - a.y * b.x;
}
inline double norm(Vec2 a) {
  return std::sqrt(dot(a, a));
}

inline Vec3 operator+(Vec3 a, Vec3 b) {
  return {a.x + b.x, a.y + b.y, a.z + b.z};
}
inline Vec3 operator-(Vec3 a, Vec3 b) {
  return {a.x - b.x, a.y - b.y, a.z - b.z};
}
inline Vec3 operator*(double s, Vec3 a) {
  return {s * a.x, s * a.y, s * a.z};
}
inline double dot(Vec3 a, Vec3 b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}
inline double norm(Vec3 a) {
  return std::sqrt(dot(a, a));
}

/// A smooth version of min(a, b) with the width k > 0. It equals min(a, b) if |a - b| >= k;
/// otherwise it is lower, by at most k/4.
inline double smooth_min(double a, double b, double k) {
  const double h = std::max(k - std::abs(a - b), 0.0) / k;
  return std::min(a, b) - h * h * k * 0.25;
}
inline double smooth_max(double a, double b, double k) {
  return -smooth_min(-a, -b, k);
}

inline double sphere_distance(Vec3 p, Vec3 centre, double radius) {
  return norm(p - centre) - radius;
}

/// The exact signed distance from the convex hull of two spheres (radius_a at a, radius_b at b).
/// The radii must differ by less than the distance of the centres.
inline double round_cone_distance(Vec3 p, Vec3 a, Vec3 b, double radius_a, double radius_b) {
  const Vec3 ba = b - a, pa = p - a;
  const double l2 = dot(ba, ba), rr = radius_a - radius_b, a2 = l2 - rr * rr, il2 = 1.0 / l2;
  const double y = dot(pa, ba), z = y - l2;
  const Vec3 across = l2 * pa - y * ba;
  const double x2 = dot(across, across), y2 = y * y * l2, z2 = z * z * l2;
  const double k = (rr < 0 ? -1.0 : (rr > 0 ? 1.0 : 0.0)) * rr * rr * x2;
  if ((z < 0 ? -1.0 : 1.0) * a2 * z2 > k) return std::sqrt(x2 + z2) * il2 - radius_b;
  if ((y < 0 ? -1.0 : 1.0) * a2 * y2 < k) return std::sqrt(x2 + y2) * il2 - radius_a;
  return (std::sqrt(x2 * a2 * il2) + y * rr) * il2 - radius_a;
}

/// The exact signed distance from a simple polygon in the plane. The vertices may run
/// clockwise or counter-clockwise. O(vertices).
inline double polygon_distance(Vec2 p, std::span<const Vec2> polygon) {
  Vec2 previous = polygon.back();
  double d2 = dot(p - polygon[0], p - polygon[0]);
  bool inside = false;
  for (const Vec2 v : polygon) {
    const Vec2 e = previous - v, w = p - v;
    const Vec2 b = w - std::clamp(dot(w, e) / dot(e, e), 0.0, 1.0) * e;
    d2 = std::min(d2, dot(b, b));
    const bool above = p.y >= v.y, below = p.y<previous.y, left = e.x * w.y> e.y * w.x;
    if ((above && below && left) || (!above && !below && !left)) inside = !inside;
    previous = v;
  }
  return (inside ? -1.0 : 1.0) * std::sqrt(d2);
}

/// The signed distance from a plane shape that is extruded by half_thickness to both sides along
/// its normal and then grown by `rounding`. `in_plane` is the signed distance from the shape in the
/// plane, `off_plane` the coordinate along the normal.
inline double plate_distance(double in_plane, double off_plane, double half_thickness,
                             double rounding) {
  const double w = std::abs(off_plane) - half_thickness;
  return std::min(std::max(in_plane, w), 0.0) +
         norm(Vec2{std::max(in_plane, 0.0), std::max(w, 0.0)}) - rounding;
}

/// The signed distance from a box with half sizes `half` about the origin, grown by `rounding`.
inline double rounded_box_distance(Vec3 p, Vec3 half, double rounding) {
  const Vec3 q{std::abs(p.x) - half.x, std::abs(p.y) - half.y, std::abs(p.z) - half.z};
  return norm(Vec3{std::max(q.x, 0.0), std::max(q.y, 0.0), std::max(q.z, 0.0)}) +
         std::min(std::max({q.x, q.y, q.z}), 0.0) - rounding;
}

}  // namespace trocar::sample
