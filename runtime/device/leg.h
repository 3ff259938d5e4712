// SPDX-License-Identifier: Apache-2.0
// One leg of the mechanism in its own frame: x radially outward, y tangential,
// z up, origin at {B}. Points A, B, C, D, E, F as in README.md. Internal to the
// kinematics; the haptic thread calls all of it.
#pragma once

#include <Eigen/Core>
#include <cmath>

#include "formats/device_description.h"
#include "runtime/device/device.h"

namespace trocar::runtime::leg {

// Azimuths are multiples of a right angle, so turning is exact.
inline constexpr double kCosAzimuth[kLegs] = {1, 0, -1, 0};
inline constexpr double kSinAzimuth[kLegs] = {0, 1, 0, -1};

inline Eigen::Vector3d to_leg(int leg, const Eigen::Vector3d& v) noexcept {
  const double c = kCosAzimuth[leg], s = kSinAzimuth[leg];
  return {c * v.x() + s * v.y(), c * v.y() - s * v.x(), v.z()};
}
inline Eigen::Vector3d from_leg(int leg, const Eigen::Vector3d& v) noexcept {
  const double c = kCosAzimuth[leg], s = kSinAzimuth[leg];
  return {c * v.x() - s * v.y(), s * v.x() + c * v.y(), v.z()};
}

/// The plate's ball joint C in the plate's frame {T}.
inline Eigen::Vector3d plate_joint(const DeviceGeometry& g, int leg) noexcept {
  return {g.R_T_m * kCosAzimuth[leg], g.R_T_m * kSinAzimuth[leg], 0};
}

/// A, on the axis of theta1.
inline Eigen::Vector3d upper_motor(const DeviceGeometry& g) noexcept {
  return {g.R_B1_m, 0, g.z_A_m};
}
/// B, on the axis of theta4.
inline Eigen::Vector3d lower_motor(const DeviceGeometry& g) noexcept {
  return {g.R_B2_m * std::cos(g.d_rad), g.R_B2_m * std::sin(g.d_rad), g.z_A_m - g.H_B_m};
}
/// u(a) = (cos a, 0, sin a), the upper chain's plane, and u'(a).
inline Eigen::Vector3d upper_direction(double a) noexcept {
  return {std::cos(a), 0, std::sin(a)};
}
inline Eigen::Vector3d upper_derivative(double a) noexcept {
  return {-std::sin(a), 0, std::cos(a)};
}
/// v(a) = (cos a, sin a, 0), the lower chain's plane, and v'(a).
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
/// F, the end of the lower motor's link.
inline Eigen::Vector3d lower_elbow(const DeviceGeometry& g, double th4) noexcept {
  return lower_motor(g) + g.l3_m * lower_direction(th4);
}
/// The ball joint C by the upper chain.
inline Eigen::Vector3d upper_tip(const DeviceGeometry& g, double th1, double th2,
                                 double th3) noexcept {
  return elbow(g, th1) + g.l2_m * (std::cos(th3) * upper_direction(th1 + th2) +
                                   std::sin(th3) * Eigen::Vector3d::UnitY());
}
/// D on the upper link EC.
inline Eigen::Vector3d link_joint(const DeviceGeometry& g, const Eigen::Vector3d& E,
                                  const Eigen::Vector3d& C) noexcept {
  return E + (g.l5_m / g.l2_m) * (C - E);
}

}  // namespace trocar::runtime::leg
