// SPDX-License-Identifier: Apache-2.0
// The pose from the eight motor angles alone, as a device without encoders at its passive joints
// would have to compute it. The product computes the pose from th1 to th3 of every leg.
#pragma once

#include <cstdint>

#include "runtime/mechanism/kinematics.h"

namespace trocar::runtime {

enum class MotorPoseFailure : std::uint8_t {
  kOk,
  kBadInput,      ///< a number is not finite, or a quaternion is not of unit length
  kSingular,      ///< the angles do not determine the pose uniquely
  kNotConverged,  ///< the iteration did not converge in the allowed number of steps
  kOtherBranch,   ///< a leg is, or may be, on another branch (LegBranch) than the description says
};
/// The text of to_string(KinematicsFailure) where there is one.
const char* to_string(MotorPoseFailure failure) noexcept;

struct MotorPoseStatus {
  MotorPoseFailure failure = MotorPoseFailure::kOk;
  int leg = 0;    ///< 1..4; 0 if the failure concerns no single leg
  int joint = 0;  ///< index of theta, 1..6; 0 if the failure concerns no single joint
  explicit operator bool() const noexcept { return failure == MotorPoseFailure::kOk; }
};

struct MotorPose {
  MotorPoseStatus status;
  Pose T_device_plate;  ///< valid if status is kOk; with kOtherBranch the pose that was rejected
  double residual_m = 0;
  int iterations = 0;
};

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
  double residual_max_m = 3e-4;  ///< largest MotorPose::residual_m
};
/// In each leg, the distance from E to C must be the link length l2, and the distance from F to D
/// the link length l4. Gauss-Newton solves these eight equations for the six unknowns of the pose.
/// The iteration starts at the last pose, which selects one of the solutions. Because there are
/// more equations than unknowns, few poses fulfil the equations exactly, but many poses nearly
/// fulfil them. From a distant start, the iteration may converge to a pose that only nearly fulfils
/// them. kOtherBranch means that the pose found is wrong, or may be wrong. The result then still
/// contains this pose, and `status` gives the reason:
///  - If status.leg and status.joint are not 0, the chain of this joint is not on the branch that
///    the description specifies.
///  - If status.leg is 0, the plate has moved too far since the last pose, or residual_m is too
///    large (an encoder may be wrong).
/// residual_m is the root mean square error of the eight distances at the pose with which the
/// iteration ended. Each iteration moves the pose by at most 20 mm and 0.4 rad per axis.
MotorPose forward_kinematics_from_motors(const DeviceDescription& device,
                                         const MotorVector& motor_rad,
                                         const Pose& T_device_plate_last,
                                         const GaussNewtonOptions& options = {}) noexcept;

/// Finds the branch of each chain of a leg: the branch for which leg::inverse() computes the given
/// th1 and th4 from C. If a chain is stretched or folded, its two branches coincide, and the
/// function returns 0 for this chain.
LegBranch branch_of(const DeviceGeometry& g, const Eigen::Vector3d& C, double th1,
                    double th4) noexcept;

}  // namespace trocar::runtime
