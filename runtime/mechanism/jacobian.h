// SPDX-License-Identifier: Apache-2.0
// First-order kinematics (paper, section III.C). With the Jacobian G, motor rates = G twist, and by
// duality wrench = G^T motor torques (Eq. 17). The twist [v; omega] is the motion of the plate, and
// the wrench [f; n] acts on the plate, both about the plate's origin and in {B}. The haptic thread
// calls these functions: no allocation, no exception. tests/runtime/mechanism/jacobian_test.cpp
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
  KinematicsStatus status;  ///< if kSingular: leg and motor joint of the stretched or folded chain
  Jacobian G = Jacobian::Zero();  ///< valid only if status is kOk
};

/// Computes the Jacobian by differentiating the constraints |C - E| = l2 and |D - F| = l4
/// (README.md). Precondition: `joints` are the joint angles of the pose (inverse_kinematics()).
/// About 200 multiplications.
JacobianResult jacobian(const DeviceDescription& device, const Pose& T_device_plate,
                        const JointAngles& joints) noexcept;

/// Length that makes a rotation in rad comparable with a translation: about the plate's radius.
inline constexpr double kCharacteristicLength_m = 0.05;

/// Smallest and largest singular value of G, after the columns of G that belong to omega are
/// divided by a characteristic length. The errors are about 1e-13 of the largest value. Both values
/// are 0 if G is not finite. singularity.h has further measures.
struct SingularRange {
  double smallest = 0, largest = 0;
};
SingularRange singular_range(const Jacobian& G,
                             double characteristic_length_m = kCharacteristicLength_m) noexcept;

}  // namespace trocar::runtime
