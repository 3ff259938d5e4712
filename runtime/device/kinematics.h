// SPDX-License-Identifier: Apache-2.0
// Position kinematics of the four-legged device (paper, section III.B; the
// reading of its lengths stands in README.md). Every function is called from the
// haptic thread: no allocation, no exception, bounded loops.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>

#include "formats/device_description.h"
#include "runtime/device/device.h"
#include "runtime/device/pose.h"

namespace trocar::runtime {

/// Leg-major th1, th4 of leg 1, of leg 2, ... (as DeviceCommand).
using MotorVector = Eigen::Matrix<double, kMotors, 1>;

/// Places in MotorVector and in the encoders' array; legs from 0, which = 0 for
/// th1 and 1 for th4, joint = 0..3 for th1..th4.
constexpr int motor_index(int leg, int which) noexcept {
  return 2 * leg + which;
}
constexpr int encoder_index(int leg, int joint) noexcept {
  return 4 * leg + joint;
}

enum class KinematicsFailure : std::uint8_t {
  kOk,
  kBadInput,      ///< not finite, or a quaternion that is not of unit length
  kOutOfReach,    ///< the joint's two links cannot span the distance
  kSingular,      ///< the joint's direction or rate is not determined
  kBeyondLimit,   ///< outside the description's joint limits
  kNotConverged,  ///< the iteration met its bound
};
/// A word for logs, such as "out of reach".
const char* to_string(KinematicsFailure failure) noexcept;

struct KinematicsStatus {
  KinematicsFailure failure = KinematicsFailure::kOk;
  std::int8_t leg = 0;    ///< 1..4; 0 where it is no single leg's failure
  std::int8_t joint = 0;  ///< 1..6, theta's index; 0 likewise
  explicit operator bool() const noexcept { return failure == KinematicsFailure::kOk; }
};

/// theta_rad[leg][joint], counted from 0.
struct JointAngles {
  std::array<std::array<double, kJointsPerLeg>, kLegs> theta_rad{};
};
/// th1, th4 of each leg.
MotorVector motor_angles(const JointAngles& joints) noexcept;
/// th1..th4 of each leg, as DeviceState::encoder_rad.
std::array<double, kEncoders> encoder_angles(const JointAngles& joints) noexcept;
/// The motors' part of the encoders.
MotorVector motor_angles(const std::array<double, kEncoders>& encoder_rad) noexcept;

struct InverseResult {
  KinematicsStatus status;
  JointAngles
      joints;  ///< valid only if status holds; each within half a turn of its limits' middle
};

/// All 24 joint angles of a pose, in closed form, on the description's branches.
/// Limits are not judged here: see check_joint_limits.
InverseResult inverse_kinematics(const DeviceDescription& device,
                                 const Pose& T_device_plate) noexcept;

/// The first joint outside its limits narrowed by margin_rad at both ends, or
/// not finite. The second form judges th1..th4 only.
KinematicsStatus check_joint_limits(const DeviceDescription& device, const JointAngles& joints,
                                    double margin_rad = 0) noexcept;
KinematicsStatus check_joint_limits(const DeviceDescription& device,
                                    const std::array<double, kEncoders>& encoder_rad,
                                    double margin_rad = 0) noexcept;

struct ForwardResult {
  KinematicsStatus status;
  Pose T_device_plate;    ///< valid only if status holds
  double residual_m = 0;  ///< health check, see the functions
  int iterations = 0;
};

/// The pose from th1, th2, th3 of every leg (th4 is not used): they give the ball
/// joints C_m, and the least-squares rigid fit (Kabsch; closed form here, since
/// the C_m form a square on the plate) gives the pose. residual_m is the root
/// mean square distance between measured and fitted C_m: zero if the encoders agree.
ForwardResult forward_kinematics(const DeviceDescription& device,
                                 const std::array<double, kEncoders>& encoder_rad) noexcept;

struct GaussNewtonOptions {
  int max_iterations = 20;
  double step_m = 1e-12;  ///< converged when no component moves the plate further than this
};
/// The pose from the eight motor angles alone, by Gauss-Newton on the eight
/// constraints |C - E| = l2, |D - F| = l4 from the last pose, which picks among
/// the mechanism's several solutions. residual_m is the root mean square of the
/// constraints' errors at the end. Each iteration moves at most 20 mm and 0.4 rad an axis.
ForwardResult forward_kinematics_from_motors(const DeviceDescription& device,
                                             const MotorVector& motor_rad,
                                             const Pose& T_device_plate_last,
                                             const GaussNewtonOptions& options = {}) noexcept;

}  // namespace trocar::runtime
