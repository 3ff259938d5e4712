// SPDX-License-Identifier: Apache-2.0
// Kinematics of the four-legged device: positions, one leg, and the Jacobian.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cmath>
#include <cstdint>

#include "formats/session/device_description.h"
#include "runtime/device/device.h"

namespace trocar::runtime {

// Position kinematics of the four-legged device (paper, section III.B): joint angles from a pose
// (inverse), and a pose from joint angles (forward). Each leg has two chains of two links: the
// upper chain with the joint angles th1 to th3, and the lower chain with th4 to th6 (also theta1 to
// theta6). Motors turn th1 and th4; encoders measure th1 to th4. README.md of this folder defines
// the points A to F and the lengths. The haptic thread may call all functions: no allocation, no
// exception, bounded loops.

/// One value per motor: th1 and th4 of leg 1, then of leg 2, and so on (as in DeviceCommand).
using MotorVector = Eigen::Matrix<double, kMotors, 1>;

/// Indices into MotorVector and into the array of encoders. `leg` counts from 0. `which` is 0 for
/// th1 and 1 for th4. `joint` is 0 for th1, 1 for th2, 2 for th3 and 3 for th4.
constexpr int motor_index(int leg, int which) noexcept {
  return 2 * leg + which;
}
constexpr int encoder_index(int leg, int joint) noexcept {
  return 4 * leg + joint;
}

enum class KinematicsFailure : std::uint8_t {
  kOk,
  kBadInput,     ///< a number is not finite, or a quaternion is not of unit length
  kOutOfReach,   ///< the pose is outside the workspace: a chain's links cannot connect its ends
  kSingular,     ///< the input does not determine an angle, a rate or the pose uniquely
  kBeyondLimit,  ///< an angle is outside the description's joint limits
};
/// Name for logs and messages, such as "out of reach".
const char* to_string(KinematicsFailure failure) noexcept;

struct KinematicsStatus {
  KinematicsFailure failure = KinematicsFailure::kOk;
  int leg = 0;    ///< 1..4; 0 if the failure concerns no single leg
  int joint = 0;  ///< index of theta, 1..6; 0 if the failure concerns no single joint
  explicit operator bool() const noexcept { return failure == KinematicsFailure::kOk; }
};

/// The joint angles theta_rad[leg][joint], with leg and joint counted from 0.
struct JointAngles {
  std::array<std::array<double, kJointsPerLeg>, kLegs> theta_rad{};
};
/// The angles th1, th4 of each leg.
MotorVector motor_angles(const JointAngles& joints) noexcept;
/// The angles th1..th4 of each leg, as in DeviceState::encoder_rad.
std::array<double, kEncoders> encoder_angles(const JointAngles& joints) noexcept;
/// Selects the angles of the motors' encoders, th1 and th4 of each leg, from all encoder angles.
MotorVector motor_angles(const std::array<double, kEncoders>& encoder_rad) noexcept;

struct InverseResult {
  KinematicsStatus status;
  /// Valid only if status is kOk. Full turns are added to each angle so that it lies within half a
  /// turn of the middle of its joint's limits.
  JointAngles joints;
};

/// Computes all 24 joint angles of a pose, in closed form, on the branches (LegBranch) that the
/// description specifies. Joint limits are not checked; see check_joint_limits(). A failure other
/// than kBadInput names the first leg and joint whose angle cannot be computed.
InverseResult inverse_kinematics(const DeviceDescription& device,
                                 const Pose& T_device_plate) noexcept;

/// The branch of a leg (its working mode). A leg has up to four shapes with the same pose of the
/// plate, because the formulas for th1 and for th4 contain +acos or -acos. `theta1` and `theta4`
/// are these two signs, +1 or -1. DeviceGeometry contains the signs of the real device.
struct LegBranch {
  int theta1 = 1, theta4 = 1;
  friend bool operator==(const LegBranch&, const LegBranch&) = default;
};

/// Finds the first encoder angle that is outside its limits or not finite, and returns kBeyondLimit
/// with its leg and joint. If there is no such angle, returns kOk.
KinematicsStatus check_joint_limits(const DeviceDescription& device,
                                    const std::array<double, kEncoders>& encoder_rad) noexcept;

struct ForwardResult {
  KinematicsStatus status;
  Pose T_device_plate;    ///< valid if status is kOk
  double residual_m = 0;  ///< disagreement of the encoders; see forward_kinematics()
};

/// Computes the pose from th1, th2 and th3 of every leg (th4 is not used). The angles of leg m
/// determine the position C_m of its ball joint at the plate. The result is the pose at which the
/// plate's four ball joints fit the points C_m best (least squares, Kabsch). Because the ball
/// joints form a square on the plate, this needs no decomposition of a 3 x 3 matrix. residual_m is
/// the root mean square distance between the points C_m and the plate's ball joints; it is zero if
/// th1 to th3 of all legs agree.
ForwardResult forward_kinematics(const DeviceDescription& device,
                                 const std::array<double, kEncoders>& encoder_rad) noexcept;

}  // namespace trocar::runtime

namespace trocar::runtime::leg {

// One leg of the mechanism in the leg's own frame: x points radially outward, y is tangential, z
// points up, and the origin is that of {B}. A leg has two chains of two links: the upper chain from
// A over the elbow E to the ball joint C, and the lower chain from B over F to D (README.md of this
// folder). Outside of this folder, only runtime/device/simulated and tests use this header. The haptic
// thread calls its functions: no allocation, no exception. The azimuth of a leg is its direction
// about the z axis. The device's legs are at kAzimuth. The functions with an Azimuth parameter let
// tests compute devices that do not have four legs (tests/reference/mechanism/leg_ring.h).

/// If the distance between the ends of a chain is less than kMinSpan_m, inverse() fails with
/// kSingular, because the direction from one end to the other is then undefined.
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

namespace trocar::runtime {

// The Jacobian G of the four-legged device (paper, section III.C). G gives the motor rates for a
// twist of the plate, motor rates = G twist, and the wrench for motor torques, wrench = G^T torques
// (Eq. 17). The twist [v; omega] is the motion of the plate, and the wrench [f; n] acts on the
// plate. Both refer to the plate's origin and are expressed in {B}. The haptic thread calls these
// functions: no allocation, no exception. tests/runtime/device/four_legs/jacobian_test.cpp
// compares the Jacobian with central differences and with the paper's influence coefficients
// (tests/reference/mechanism/influence_jacobian.h).

/// One row per motor, in the order of MotorVector. The first three columns belong to v in m/s, the
/// last three to omega in rad/s.
using Jacobian = Eigen::Matrix<double, kMotors, 6>;

struct JacobianResult {
  /// If status.failure is kSingular, a chain is stretched or folded; status.leg and status.joint
  /// name the chain's leg and motor joint.
  KinematicsStatus status;
  Jacobian G = Jacobian::Zero();  ///< valid only if status is kOk
};

/// Computes the Jacobian by differentiating the constraints |C - E| = l2 and |D - F| = l4, which
/// say that two links of each leg have constant lengths. (README.md of this folder defines the
/// points and lengths.) Precondition: `joints` are the joint angles of the pose
/// (inverse_kinematics()). The function needs about 200 multiplications.
JacobianResult jacobian(const DeviceDescription& device, const Pose& T_device_plate,
                        const JointAngles& joints) noexcept;

/// Length by which an angle in rad is multiplied to compare it with a translation. It is similar to
/// the plate's radius.
inline constexpr double kCharacteristicLength_m = 0.05;

/// Smallest and largest singular value of G, after the columns of G that belong to omega are
/// divided by kCharacteristicLength_m. The error of each value is about 1e-13 of `largest`. Both
/// values are 0 if G is not finite. mechanism_limits.h has further measures of how close a pose is to a
/// singularity.
struct SingularRange {
  double smallest = 0, largest = 0;
};
SingularRange singular_range(const Jacobian& G) noexcept;

}  // namespace trocar::runtime
