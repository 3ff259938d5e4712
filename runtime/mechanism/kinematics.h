// SPDX-License-Identifier: Apache-2.0
// Position kinematics of the four-legged device (paper, section III.B; README.md defines the points
// and lengths). Functions may be called from the haptic thread: no allocation, no exception,
// bounded loops.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>

#include "formats/session/device_description.h"
#include "runtime/device/device.h"
#include "runtime/mechanism/pose.h"

namespace trocar::runtime {

/// One value per motor, leg-major: th1, th4 of leg 1, then of leg 2, ... (as in DeviceCommand).
using MotorVector = Eigen::Matrix<double, kMotors, 1>;

/// Indices into MotorVector and into the encoders' array. Legs count from 0; which = 0 for th1 and
/// 1 for th4; joint = 0..3 for th1..th4.
constexpr int motor_index(int leg, int which) noexcept {
  return 2 * leg + which;
}
constexpr int encoder_index(int leg, int joint) noexcept {
  return 4 * leg + joint;
}

enum class KinematicsFailure : std::uint8_t {
  kOk,
  kBadInput,      ///< not finite, or a quaternion that is not of unit length
  kOutOfReach,    ///< the pose is outside the workspace: the joint's links cannot span the distance
  kSingular,      ///< the joint's direction or rate is not determined
  kBeyondLimit,   ///< outside the description's joint limits
  kNotConverged,  ///< the iteration reached its limit
  kOtherBranch,   ///< the iteration ended on another assembly branch, or may have
};
/// A name for logs and messages, such as "out of reach".
const char* to_string(KinematicsFailure failure) noexcept;

struct KinematicsStatus {
  KinematicsFailure failure = KinematicsFailure::kOk;
  std::int8_t leg = 0;    ///< 1..4; 0 if the failure concerns no single leg
  std::int8_t joint = 0;  ///< theta's index 1..6; 0 if the failure concerns no single joint
  explicit operator bool() const noexcept { return failure == KinematicsFailure::kOk; }
};

/// theta_rad[leg][joint], counted from 0.
struct JointAngles {
  std::array<std::array<double, kJointsPerLeg>, kLegs> theta_rad{};
};
/// The angles th1, th4 of each leg.
MotorVector motor_angles(const JointAngles& joints) noexcept;
/// The angles th1..th4 of each leg, as in DeviceState::encoder_rad.
std::array<double, kEncoders> encoder_angles(const JointAngles& joints) noexcept;
/// The angles of the motors' encoders.
MotorVector motor_angles(const std::array<double, kEncoders>& encoder_rad) noexcept;

struct InverseResult {
  KinematicsStatus status;
  /// Valid only if status holds. Each angle is within half a turn of the middle of its limits.
  JointAngles joints;
};

/// Computes all 24 joint angles of a pose, in closed form, on the description's branches. It does
/// not check the joint limits; see check_joint_limits. A failure names the first leg and joint
/// without a solution.
InverseResult inverse_kinematics(const DeviceDescription& device,
                                 const Pose& T_device_plate) noexcept;

/// The assembly of a leg: the sign of acos in th1 and in th4 (DeviceGeometry).
struct LegBranch {
  int theta1 = 1, theta4 = 1;
  friend bool operator==(const LegBranch&, const LegBranch&) = default;
};

/// Finds the first of th1..th4 that is outside its limits or not finite.
KinematicsStatus check_joint_limits(const DeviceDescription& device,
                                    const std::array<double, kEncoders>& encoder_rad) noexcept;

struct ForwardResult {
  KinematicsStatus status;
  Pose T_device_plate;    ///< valid only if status holds
  double residual_m = 0;  ///< consistency of the encoders; see the functions
  int iterations = 0;
};

/// Computes the pose from th1, th2, th3 of every leg (th4 is not used). The angles determine the
/// ball joints C_m, and the least-squares rigid fit to these is the pose (Kabsch; in closed form,
/// since the C_m form a square on the plate). residual_m is the root mean square distance between
/// measured and fitted C_m, which is zero if the encoders agree.
ForwardResult forward_kinematics(const DeviceDescription& device,
                                 const std::array<double, kEncoders>& encoder_rad) noexcept;

struct GaussNewtonOptions {
  int max_iterations = 20;
  double step_m = 1e-12;  ///< the iteration has converged if no component moves farther than this
  /// Beyond either of these the result is kOtherBranch. With the defaults every wrong solution is
  /// detected from starts up to 100 mm and 60 deg away
  /// (tests/runtime/mechanism/kinematics_test.cpp). To search from farther away, raise the first.
  double travel_max_m = 0.01;  ///< plate motion since the last pose; a radian counts as 0.05 m
  double residual_max_m = 3e-4;
};
/// Computes the pose from the eight motor angles alone, for a device without passive encoders, by
/// Gauss-Newton on the eight constraints |C - E| = l2, |D - F| = l4. The iteration starts at the
/// last pose, which selects one of the mechanism's several solutions. Eight angles for six degrees
/// of freedom leave few exact solutions but many near ones, in which an iteration that starts far
/// away can end. kOtherBranch means that it did, or may have. The pose is returned then too:
///  - With leg and joint, that chain is on the branch that is not the description's.
///  - With leg 0, the plate has travelled too far since the last pose, or the angles fit the pose
///    too badly (an encoder may be wrong).
/// residual_m is the root mean square of the constraints' errors at the end. Each iteration moves
/// at most 20 mm and 0.4 rad per axis.
ForwardResult forward_kinematics_from_motors(const DeviceDescription& device,
                                             const MotorVector& motor_rad,
                                             const Pose& T_device_plate_last,
                                             const GaussNewtonOptions& options = {}) noexcept;

}  // namespace trocar::runtime
