// SPDX-License-Identifier: Apache-2.0
// The Jacobian G of the four-legged device (paper, section III.C). G gives the motor rates for a
// twist of the plate, motor rates = G twist, and the wrench for motor torques, wrench = G^T torques
// (Eq. 17). The twist [v; omega] is the motion of the plate, and the wrench [f; n] acts on the
// plate. Both refer to the plate's origin and are expressed in {B}. The haptic thread calls these
// functions: no allocation, no exception. tests/runtime/mechanism/jacobian_test.cpp
// compares the Jacobian with central differences and with the paper's influence coefficients
// (tests/reference/mechanism/influence_jacobian.h).
#pragma once

#include <Eigen/Core>

#include "formats/session/device_description.h"
#include "runtime/mechanism/kinematics.h"

namespace trocar::runtime {

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
/// values are 0 if G is not finite. singularity.h has further measures of how close a pose is to a
/// singularity.
struct SingularRange {
  double smallest = 0, largest = 0;
};
SingularRange singular_range(const Jacobian& G) noexcept;

}  // namespace trocar::runtime
