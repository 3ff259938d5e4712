// SPDX-License-Identifier: Apache-2.0
// Rigid transforms, twists and wrenches of the device, in SI units. Nothing here allocates. The
// name of a pose states its frames: T_device_plate maps coordinates in the plate's frame {T} to
// coordinates in the device's frame {B}.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cmath>
#include <numbers>

namespace trocar::runtime {

inline constexpr double kDegreesPerRadian = 180 / std::numbers::pi;

/// A twist [v; omega]: velocity of a frame's origin in m/s, and angular velocity in rad/s.
using Twist = Eigen::Matrix<double, 6, 1>;
/// A wrench [f; n]: force in N, and moment in N*m about a frame's origin.
using Wrench = Eigen::Matrix<double, 6, 1>;

/// A pose T_a_b of the frame {b} in the frame {a}: `p_m` is the position of the origin of {b}, and
/// `q` rotates coordinates of {b} into {a}.
struct Pose {
  Eigen::Vector3d p_m = Eigen::Vector3d::Zero();
  Eigen::Quaterniond q = Eigen::Quaterniond::Identity();  ///< unit quaternion
};

/// An earlier pose from which the present velocity is computed. The velocity is the displacement
/// from the earlier pose to the present one, divided by `ago_s`. runtime/control/velocity_window.h
/// chooses the earlier pose.
struct PreviousPose {
  Pose T_device_plate;
  /// Time since T_device_plate. 0 means that no pose was chosen; use the pose of the last new
  /// reading instead.
  double ago_s = 0;
};

/// Composition: T_a_c = T_a_b * T_b_c.
inline Pose operator*(const Pose& T_a_b, const Pose& T_b_c) noexcept {
  return {T_a_b.p_m + T_a_b.q * T_b_c.p_m, (T_a_b.q * T_b_c.q).normalized()};
}
inline Eigen::Vector3d operator*(const Pose& T_a_b, const Eigen::Vector3d& p_b) noexcept {
  return T_a_b.p_m + T_a_b.q * p_b;
}
inline Pose inverse(const Pose& T_a_b) noexcept {
  const Eigen::Quaterniond q_b_a = T_a_b.q.conjugate();
  return {-(q_b_a * T_a_b.p_m), q_b_a};
}
inline bool is_finite(const Pose& T) noexcept {
  return T.p_m.allFinite() && T.q.coeffs().allFinite();
}

/// Returns the shortest rotation that turns z to the direction of `d`, which is not zero. For -z it
/// is half a turn about x. (Eigen's FromTwoVectors would compile a singular value decomposition in
/// each file.)
inline Eigen::Quaterniond rotation_from_z(const Eigen::Vector3d& d) noexcept {
  const double across = std::hypot(d.x(), d.y());
  if (across == 0) return {d.z() < 0 ? 0.0 : 1.0, d.z() < 0 ? 1.0 : 0.0, 0, 0};
  const double half_rad = std::atan2(across, d.z()) / 2, sine = std::sin(half_rad);
  return {std::cos(half_rad), -d.y() / across * sine, d.x() / across * sine, 0};
}

/// Returns the rotation vector of a unit quaternion: axis times angle, with the angle in [0, pi].
inline Eigen::Vector3d rotation_vector(const Eigen::Quaterniond& q) noexcept {
  const double sign = q.w() < 0 ? -1 : 1;
  const Eigen::Vector3d v = sign * q.vec();
  const double sine = v.norm();
  const double factor = sine < 1e-12 ? 2.0 : 2 * std::atan2(sine, sign * q.w()) / sine;
  return factor * v;
}

/// Returns [translation of the frame's origin; rotation vector] of the motion from `from` to `to`,
/// in {B}. A wrench that is constant during this motion does the work wrench * displacement.
inline Twist displacement(const Pose& from, const Pose& to) noexcept {
  Twist step;
  step << to.p_m - from.p_m, rotation_vector(to.q * from.q.conjugate());
  return step;
}

/// Returns the unit quaternion of the rotation about r by the angle |r|. This function is the
/// inverse of rotation_vector().
inline Eigen::Quaterniond from_rotation_vector(const Eigen::Vector3d& r) noexcept {
  const double angle = r.norm();
  const double factor = angle < 1e-6 ? 0.5 - angle * angle / 48 : std::sin(angle / 2) / angle;
  Eigen::Quaterniond q;
  q.w() = std::cos(angle / 2);
  q.vec() = factor * r;
  return q.normalized();
}

/// Returns the same wrench with its moment taken about a new point. `lever_m` points from the new
/// point to the point about which the moment of `wrench` is taken.
inline Wrench moved_by(const Wrench& wrench, const Eigen::Vector3d& lever_m) noexcept {
  Wrench moved = wrench;
  moved.tail<3>() += lever_m.cross(Eigen::Vector3d(wrench.head<3>()));
  return moved;
}

}  // namespace trocar::runtime
