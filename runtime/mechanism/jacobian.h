// SPDX-License-Identifier: Apache-2.0
// First-order kinematics (paper, section III.C): motor rates = G twist, and by duality
// wrench = G^T motor torques (Eq. 17). Twist and wrench are those of the plate's origin, in {B}:
// [v; omega], [f; n]. Called from the haptic thread: no allocation, no exception.
// tests/runtime/mechanism/jacobian_test.cpp compares it with central differences and with the
// paper's influence coefficients (tests/reference/mechanism/influence_jacobian.h).
#pragma once

#include <Eigen/Core>

#include "formats/session/device_description.h"
#include "runtime/mechanism/kinematics.h"

namespace trocar::runtime {

/// Rows: motors, leg-major th1, th4; columns: v in m/s, omega in rad/s.
using Jacobian = Eigen::Matrix<double, kMotors, 6>;

struct JacobianResult {
  KinematicsStatus status;  ///< kSingular names the leg and motor joint that is stretched or folded
  Jacobian G = Jacobian::Zero();  ///< valid only if status holds
};

/// Computes the Jacobian by differentiating |C - E| = l2 and |D - F| = l4. `joints` must be those
/// of the pose (inverse_kinematics). About 200 multiplications.
JacobianResult jacobian(const DeviceDescription& device, const Pose& T_device_plate,
                        const JointAngles& joints) noexcept;

/// Length that makes a rotation in rad comparable with a translation, about the plate's radius.
inline constexpr double kCharacteristicLength_m = 0.05;

/// Smallest and largest singular value of G with its columns of omega divided by a characteristic
/// length. Both are accurate to about 1e-13 of the largest, and 0 if G is not finite. singularity.h
/// has further measures.
struct SingularRange {
  double smallest = 0, largest = 0;
};
SingularRange singular_range(const Jacobian& G,
                             double characteristic_length_m = kCharacteristicLength_m) noexcept;

}  // namespace trocar::runtime
