// SPDX-License-Identifier: Apache-2.0
// Position kinematics of the four-legged device (paper, section III.B): joint angles from a pose
// (inverse), and a pose from joint angles (forward). README.md defines the points, lengths and
// angles. The haptic thread may call all functions: no allocation, no exception, bounded loops.
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

/// Indices into MotorVector and into the array of encoders. `leg` counts from 0; `which` is 0 for
/// th1 and 1 for th4; `joint` is 0..3 for th1..th4.
constexpr int motor_index(int leg, int which) noexcept {
  return 2 * leg + which;
}
constexpr int encoder_index(int leg, int joint) noexcept {
  return 4 * leg + joint;
}

enum class KinematicsFailure : std::uint8_t {
  kOk,
  kBadInput,      ///< not finite, or a quaternion that is not of unit length
  kOutOfReach,    ///< the pose is outside the workspace: a chain's links cannot connect its ends
  kSingular,      ///< an angle, a rate or the pose is not determined
  kBeyondLimit,   ///< an angle is outside the description's joint limits
  kNotConverged,  ///< the iteration did not converge in the allowed number of steps
  kOtherBranch,   ///< a leg is on another branch (LegBranch), or this cannot be excluded
};
/// Name for logs and messages, such as "out of reach".
const char* to_string(KinematicsFailure failure) noexcept;

struct KinematicsStatus {
  KinematicsFailure failure = KinematicsFailure::kOk;
  std::int8_t leg = 0;    ///< 1..4; 0 if the failure concerns no single leg
  std::int8_t joint = 0;  ///< index of theta, 1..6; 0 if the failure concerns no single joint
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
/// The angles of the motors' encoders.
MotorVector motor_angles(const std::array<double, kEncoders>& encoder_rad) noexcept;

struct InverseResult {
  KinematicsStatus status;
  /// Valid only if status is kOk. Each angle is within half a turn of the middle of its limits.
  JointAngles joints;
};

/// Computes all 24 joint angles of a pose, in closed form, on the assembly branches that the
/// description specifies. Joint limits are not checked; see check_joint_limits(). A failure names
/// the first leg and joint without a solution.
InverseResult inverse_kinematics(const DeviceDescription& device,
                                 const Pose& T_device_plate) noexcept;

/// The assembly branch of a leg. A leg has up to four shapes with the same pose of the plate,
/// because the formulas for th1 and for th4 contain +acos or -acos. A branch is these two signs, +1
/// or -1 (DeviceGeometry).
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
  Pose T_device_plate;    ///< valid only if status is kOk
  double residual_m = 0;  ///< disagreement of the encoders, as the called function defines it
  int iterations = 0;
};

/// Computes the pose from th1, th2 and th3 of every leg (th4 is not used). These angles determine
/// the positions of the ball joints C_m. The pose is the least-squares rigid fit to these points
/// (Kabsch), which has a closed form because the C_m form a square on the plate. residual_m is the
/// root mean square distance between measured and fitted C_m. If the encoders agree, it is zero.
ForwardResult forward_kinematics(const DeviceDescription& device,
                                 const std::array<double, kEncoders>& encoder_rad) noexcept;

struct GaussNewtonOptions {
  int max_iterations = 20;
  double step_m = 1e-12;  ///< largest step component at convergence; 1 rad counts as 0.05 m
  /// If the plate moved more than travel_max_m, or if the residual exceeds residual_max_m, the
  /// result is kOtherBranch. In tests with the defaults, every pose with status kOk was right, even
  /// from starts up to 100 mm and 60 deg away (tests/runtime/mechanism/kinematics_test.cpp). To
  /// allow larger motions, increase travel_max_m.
  double travel_max_m = 0.01;  ///< largest plate motion since the last pose; 1 rad counts as 0.05 m
  double residual_max_m = 3e-4;
};
/// Computes the pose from the eight motor angles alone, for a device without encoders at its
/// passive joints, by Gauss-Newton on the constraints |C - E| = l2 and |D - F| = l4 of the four
/// legs. The iteration starts at the last pose, which selects one of the solutions. The system is
/// overdetermined (eight equations, six unknowns): it has few exact solutions but many
/// near-solutions, and an iteration from a distant start may converge to a near-solution.
/// kOtherBranch means that the iteration has converged to a wrong solution, or that this cannot be
/// excluded. The pose is then still the result of the iteration, and `status` gives the reason:
///  - If status.leg and status.joint are not 0, the chain of this joint is not on the branch that
///    the description specifies.
///  - If status.leg is 0, the plate has moved too far since the last pose, or the angles fit the
///    pose too badly (an encoder may be wrong).
/// residual_m is the root mean square of the constraints' errors at the end. Each iteration moves
/// the pose by at most 20 mm and 0.4 rad per axis.
ForwardResult forward_kinematics_from_motors(const DeviceDescription& device,
                                             const MotorVector& motor_rad,
                                             const Pose& T_device_plate_last,
                                             const GaussNewtonOptions& options = {}) noexcept;

}  // namespace trocar::runtime
