// SPDX-License-Identifier: Apache-2.0
// One leg of the mechanism in the leg's own frame: x points radially outward, y is tangential, z
// points up, and the origin is that of {B}. A leg has two chains of two links: the upper chain from
// A over the elbow E to the ball joint C, and the lower chain from B over F to D (README.md of this
// folder). Outside of this folder, only runtime/simulation and tests use this header. The haptic
// thread calls its functions: no allocation, no exception. The azimuth of a leg is its direction
// about the z axis. The device's legs are at kAzimuth. The functions with an Azimuth parameter let
// tests compute devices that do not have four legs (tests/reference/mechanism/leg_ring.h).
#pragma once

#include <Eigen/Core>
#include <array>
#include <cmath>

#include "formats/session/device_description.h"
#include "runtime/device/device.h"
#include "runtime/mechanism/kinematics.h"

namespace trocar::runtime::leg {

/// If the distance between the ends of a chain is less than kMinSpan_m, inverse() fails with
/// kSingular, because the direction from one end to the other is then undefined.
/// forward_kinematics_from_motors() has the same limit for the distances E to C and F to D.
inline constexpr double kMinSpan_m = 1e-9;

struct Azimuth {
  double cosine = 1, sine = 0;
};
/// The azimuths of the device's legs. They are multiples of a right angle, so that rotations into
/// and out of a leg's frame have no rounding error.
inline constexpr std::array<Azimuth, kLegs> kAzimuth = {Azimuth{1, 0}, Azimuth{0, 1},
                                                        Azimuth{-1, 0}, Azimuth{0, -1}};

/// Rotates a vector from {B} into the leg's frame; from_leg() rotates back.
inline Eigen::Vector3d to_leg(const Azimuth& a, const Eigen::Vector3d& v) noexcept {
  return {a.cosine * v.x() + a.sine * v.y(), a.cosine * v.y() - a.sine * v.x(), v.z()};
}
inline Eigen::Vector3d from_leg(const Azimuth& a, const Eigen::Vector3d& v) noexcept {
  return {a.cosine * v.x() - a.sine * v.y(), a.sine * v.x() + a.cosine * v.y(), v.z()};
}
/// The plate's ball joint C in the plate's frame {T}.
inline Eigen::Vector3d plate_joint(const DeviceGeometry& g, const Azimuth& a) noexcept {
  return {g.R_T_m * a.cosine, g.R_T_m * a.sine, 0};
}
inline Eigen::Vector3d to_leg(int leg, const Eigen::Vector3d& v) noexcept {
  return to_leg(kAzimuth[leg], v);
}
inline Eigen::Vector3d from_leg(int leg, const Eigen::Vector3d& v) noexcept {
  return from_leg(kAzimuth[leg], v);
}
inline Eigen::Vector3d plate_joint(const DeviceGeometry& g, int leg) noexcept {
  return plate_joint(g, kAzimuth[leg]);
}

/// The point A on the axis of theta1.
inline Eigen::Vector3d upper_motor(const DeviceGeometry& g) noexcept {
  return {g.R_B1_m, 0, g.z_A_m};
}
/// The point B on the axis of theta4.
inline Eigen::Vector3d lower_motor(const DeviceGeometry& g) noexcept {
  return {g.R_B2_m * std::cos(g.d_rad), g.R_B2_m * std::sin(g.d_rad), g.z_A_m - g.H_B_m};
}
/// The direction u(a) = (cos a, 0, sin a) in the upper chain's plane, and its derivative u'(a).
inline Eigen::Vector3d upper_direction(double a) noexcept {
  return {std::cos(a), 0, std::sin(a)};
}
inline Eigen::Vector3d upper_derivative(double a) noexcept {
  return {-std::sin(a), 0, std::cos(a)};
}
/// The direction v(a) = (cos a, sin a, 0) in the lower chain's plane, and its derivative v'(a).
inline Eigen::Vector3d lower_direction(double a) noexcept {
  return {std::cos(a), std::sin(a), 0};
}
inline Eigen::Vector3d lower_derivative(double a) noexcept {
  return {-std::sin(a), std::cos(a), 0};
}
/// The elbow E.
inline Eigen::Vector3d elbow(const DeviceGeometry& g, double th1) noexcept {
  return upper_motor(g) + g.l1_m * upper_direction(th1);
}
/// The point F at the end of the lower motor's link.
inline Eigen::Vector3d lower_elbow(const DeviceGeometry& g, double th4) noexcept {
  return lower_motor(g) + g.l3_m * lower_direction(th4);
}
/// The ball joint C, computed along the upper chain.
inline Eigen::Vector3d upper_tip(const DeviceGeometry& g, double th1, double th2,
                                 double th3) noexcept {
  return elbow(g, th1) + g.l2_m * (std::cos(th3) * upper_direction(th1 + th2) +
                                   std::sin(th3) * Eigen::Vector3d::UnitY());
}
/// The point D on the upper link EC.
inline Eigen::Vector3d link_joint(const DeviceGeometry& g, const Eigen::Vector3d& E,
                                  const Eigen::Vector3d& C) noexcept {
  return E + (g.l5_m / g.l2_m) * (C - E);
}

/// Computes theta1..theta6 for the ball joint at C (in the leg's frame) on the branch
/// `branch`. Each angle is within half a turn of the middle of its limits. The status does not name
/// the leg.
KinematicsStatus inverse(const DeviceDescription& device, const Eigen::Vector3d& C,
                         LegBranch branch, std::array<double, kJointsPerLeg>& theta) noexcept;

/// Finds the branch of each chain: the branch for which inverse() computes the given th1
/// and th4 from C. If a chain is stretched or folded, its two branches coincide, and the function
/// returns 0 for this chain.
LegBranch branch_of(const DeviceGeometry& g, const Eigen::Vector3d& C, double th1,
                    double th4) noexcept;

/// Computes the vectors w1 and w4 that give the motor rates of one leg: th1' = w1 . C' and
/// th4' = w4 . C'. The prime is the time derivative; all vectors are in the leg's frame. Fails with
/// kSingular if a chain is stretched or folded. The status does not name the leg.
KinematicsStatus motor_rates(const DeviceGeometry& g, const Eigen::Vector3d& C, double th1,
                             double th4, Eigen::Vector3d& w1, Eigen::Vector3d& w4) noexcept;

/// Returns the distance in m of a chain's end point to the nearest point at which the chain's two
/// branches coincide. The coordinates of the end point are relative to the chain's motor: px and py
/// lie in the plane in which the first link (length a) turns, and pn is along the plane's normal.
/// The second link (length b) ends on a sphere of radius b about the end of the first link. Let r
/// be the length of (px, py). Then, in a diagram with the axes r and pn, the chain reaches the
/// points inside the circle of radius b about (a, 0) and outside the circle of radius b about
/// (-a, 0). The branches coincide on these two circles. If the chain cannot reach the end point,
/// the distance is negative.
inline double branch_distance(double px, double py, double pn, double a, double b) noexcept {
  const double span = std::hypot(px, py);
  return std::min(b - std::hypot(span - a, pn), std::hypot(span + a, pn) - b);
}

}  // namespace trocar::runtime::leg
