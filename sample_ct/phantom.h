// SPDX-License-Identifier: Apache-2.0
// The phantom: a lumbar vertebra and what surrounds it.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <span>

namespace trocar::sample {

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

// The bone of the phantom: an L3-like lumbar vertebra as a blend of analytic solids. The same
// vertebra is repeated above and below, so that the facet joints (the small joints between the
// arches of neighbouring vertebrae) are complete, as in a real scan.
//
// Anatomical frame (mm): x to the patient's left, y to the back, z up; origin at the middle of the
// vertebral body of the middle vertebra. The left half is the mirror image of the right half.
// Proportions follow a clinical CT of an L3 (see README.md).

/// Distance between neighbouring vertebrae along z: 28 mm for the body and 10 mm for the disc.
inline constexpr double kVertebraPitch_mm = 38.0;
/// Half the height of the vertebral body, measured at the rim of its end plates (its upper and
/// lower faces, which are hollow in the middle).
inline constexpr double kBodyHalfHeight_mm = 14.0;

/// The bone near a point.
struct BoneSample {
  double distance_mm = 0;  ///< signed distance to the outer surface, negative inside
  double cortical_mm = 1;  ///< thickness of the cortical shell near the point
};

/// The bone (all vertebrae) at a point of the anatomical frame. The distance is 1-Lipschitz
/// (above). It has the sign of the exact distance, and its magnitude never exceeds that of the
/// exact distance. At the side walls of a vertebral body the magnitude is at most 4 % too small.
BoneSample sample_bone(Vec3 p);

// The phantom: tissue and radio-density (HU) at any point in space. Formulas describe the shape of
// the bone (above); soft tissue is made of simple solids. Bone and soft tissue have a faint
// random texture, which depends on a seed. render.h computes pixels and slices and adds noise.
//
// Scan frame: DICOM's patient frame, LPS in mm, z along the patient. The anatomy is slightly
// rotated about z and shifted in this frame (PhantomOptions), so that nothing is aligned with the
// pixel grid by accident.
//
// The HU include the scanner's in-plane blur (point spread). The blur is a formula: at the signed
// distance d from a surface, the HU are f times those of the inner tissue plus 1 - f times those of
// the outer tissue, with f = Phi(-d / sigma). Phi is the cumulative normal distribution, and sigma
// is PhantomOptions::edge_sigma_mm. The formula is exact for a flat surface, and a close
// approximation if the radius of curvature is larger than sigma.

/// Mean radio-density of each tissue in HU.
struct TissueHu {
  double air = -1000;
  double fat = -100;
  double skin = 40;
  double muscle = 55;
  double bowel = 30;
  double vessel = 48;
  double disc = 90;
  double canal = 20;
  double cortical = 900;
  double cancellous = 315;
  double cancellous_texture = 40;  ///< largest deviation from `cancellous`
  double soft_texture = 9;         ///< largest deviation in fat, muscle and bowel
};

struct PhantomOptions {
  std::uint64_t seed = 1;  ///< seed of the textures
  TissueHu tissue;
  double edge_sigma_mm = 0.4;   ///< standard deviation of the in-plane blur; 0 gives sharp edges
  double rotation_rad = 0.045;  ///< rotation of the anatomy about z in the scan frame
  Vec2 shift_mm{1.7, -1.2};     ///< shift of the anatomy in the scan frame
};

/// Transforms a point from the scan frame to the anatomical frame.
Vec3 to_anatomy(const PhantomOptions& phantom, Vec3 p_scan);

/// The bone at a point of the scan frame (above): the thickness of the cortical shell, and the
/// signed distance from the bone's outer surface. The distance is negative inside, and 1-Lipschitz:
/// from point to point it changes by at most the distance of the points.
BoneSample sample_bone(const PhantomOptions& phantom, Vec3 p_scan);

/// Volume fractions, 0..1, of bone and of its cancellous core at a point, after the in-plane blur.
/// core <= bone.
struct BoneFractions {
  double bone = 0;
  double core = 0;
  BoneFractions& operator+=(BoneFractions o) { return bone += o.bone, core += o.core, *this; }
  friend BoneFractions operator*(BoneFractions f, double s) { return {f.bone * s, f.core * s}; }
};
BoneFractions blurred_fractions(const PhantomOptions& phantom, const BoneSample& bone);

/// At a point farther than this from a surface, blurred_fractions() differ from 0 or 1 by less than
/// 4e-4 (less than 0.5 HU), so they may be set to 0 or 1.
double blur_radius_mm(const PhantomOptions& phantom);

/// soft_tissue_hu() returns the HU that a point of the scan frame would have if there were no bone.
/// cancellous_hu() returns the HU that it would have if it were in the cancellous core.
double soft_tissue_hu(const PhantomOptions& phantom, Vec3 p_scan);
double cancellous_hu(const PhantomOptions& phantom, Vec3 p_scan);

/// HU of a mixture of soft tissue, cortical bone and cancellous core.
inline double mixed_hu(const PhantomOptions& phantom, BoneFractions fraction, double soft_hu,
                       double core_hu) {
  return soft_hu + (phantom.tissue.cortical - soft_hu) * fraction.bone +
         (core_hu - phantom.tissue.cortical) * fraction.core;
}

}  // namespace trocar::sample
