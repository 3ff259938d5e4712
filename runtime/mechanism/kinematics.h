// SPDX-License-Identifier: Apache-2.0
// Position kinematics of the four-legged device (paper, section III.B): joint angles from a pose
// (inverse), and a pose from joint angles (forward). Each leg has two chains of two links: the
// upper chain with the joint angles th1 to th3, and the lower chain with th4 to th6 (also theta1 to
// theta6). Motors turn th1 and th4; encoders measure th1 to th4. README.md of this folder defines
// the points A to F and the lengths. The haptic thread may call all functions: no allocation, no
// exception, bounded loops.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>

#include "formats/session/device_description.h"
#include "runtime/device/device.h"
#include "runtime/device/pose.h"

namespace trocar::runtime {

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
  kBadInput,      ///< a number is not finite, or a quaternion is not of unit length
  kOutOfReach,    ///< the pose is outside the workspace: a chain's links cannot connect its ends
  kSingular,      ///< the input does not determine an angle, a rate or the pose uniquely
  kBeyondLimit,   ///< an angle is outside the description's joint limits
  kNotConverged,  ///< the iteration did not converge in the allowed number of steps
  kOtherBranch,   ///< a leg is, or may be, on another branch (LegBranch) than the description says
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
  Pose T_device_plate;    ///< valid if status is kOk; with kOtherBranch the pose that was rejected
  double residual_m = 0;  ///< disagreement of the encoders; each function below defines it
  int iterations = 0;
};

/// Computes the pose from th1, th2 and th3 of every leg (th4 is not used). The angles of leg m
/// determine the position C_m of its ball joint at the plate. The result is the pose at which the
/// plate's four ball joints fit the points C_m best (least squares, Kabsch). Because the ball
/// joints form a square on the plate, this needs no decomposition of a 3 x 3 matrix. residual_m is
/// the root mean square distance between the points C_m and the plate's ball joints; it is zero if
/// th1 to th3 of all legs agree.
ForwardResult forward_kinematics(const DeviceDescription& device,
                                 const std::array<double, kEncoders>& encoder_rad) noexcept;

struct GaussNewtonOptions {
  int max_iterations = 20;
  /// The iteration ends after a step with no component above step_m; 1 rad counts as 0.05 m.
  double step_m = 1e-12;
  /// If the plate moved more than travel_max_m since the last pose, or if residual_m exceeds
  /// residual_max_m, the result is kOtherBranch, because from a distant start the iteration can
  /// converge to a wrong pose. In tests with the defaults, the iteration started up to 100 mm and
  /// 60 deg from the true pose, and every wrong pose was rejected
  /// (tests/runtime/mechanism/kinematics_test.cpp). To allow larger motions, increase travel_max_m.
  double travel_max_m = 0.01;  ///< largest plate motion since the last pose; 1 rad counts as 0.05 m
  double residual_max_m = 3e-4;  ///< largest ForwardResult::residual_m
};
/// Computes the pose from the eight motor angles alone, for a device without encoders at its
/// passive joints. In each leg, the distance from E to C must be the link length l2, and the
/// distance from F to D the link length l4. Gauss-Newton solves these eight equations for the six
/// unknowns of the pose. The iteration starts at the last pose, which selects one of the solutions.
/// Because there are more equations than unknowns, few poses fulfil the equations exactly, but many
/// poses nearly fulfil them. From a distant start, the iteration may converge to a pose that only
/// nearly fulfils them. kOtherBranch means that the pose found is wrong, or may be wrong. The
/// result then still contains this pose, and `status` gives the reason:
///  - If status.leg and status.joint are not 0, the chain of this joint is not on the branch that
///    the description specifies.
///  - If status.leg is 0, the plate has moved too far since the last pose, or residual_m is too
///    large (an encoder may be wrong).
/// residual_m is the root mean square error of the eight distances at the pose with which the
/// iteration ended. Each iteration moves the pose by at most 20 mm and 0.4 rad per axis.
ForwardResult forward_kinematics_from_motors(const DeviceDescription& device,
                                             const MotorVector& motor_rad,
                                             const Pose& T_device_plate_last,
                                             const GaussNewtonOptions& options = {}) noexcept;

}  // namespace trocar::runtime
