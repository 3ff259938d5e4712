// SPDX-License-Identifier: Apache-2.0
// First-order kinematics (paper, section III.C): motor rates = G twist, and by
// duality wrench = G^T motor torques (Eq. 17). Twist and wrench are of the plate's
// origin, in {B}: [v; omega], [f; n]. Two independent forms, held against each
// other and against central differences by tests/jacobian_test.cpp.
// Called from the haptic thread: no allocation, no exception.
#pragma once

#include <Eigen/Core>

#include "formats/device_description.h"
#include "runtime/device/kinematics.h"

namespace trocar::runtime {

/// Rows: motors, leg-major th1, th4; columns: v in m/s, omega in rad/s.
using Jacobian = Eigen::Matrix<double, kMotors, 6>;

struct JacobianResult {
  KinematicsStatus status;  ///< kSingular names the leg and motor joint that is stretched or folded
  Jacobian G = Jacobian::Zero();  ///< valid only if status holds
};

/// Compact form, from differentiating |C - E| = l2 and |D - F| = l4. `joints`
/// must be the pose's own (inverse_kinematics). About 200 multiplications.
JacobianResult jacobian(const DeviceDescription& device, const Pose& T_device_plate,
                        const JointAngles& joints) noexcept;

/// The paper's influence-coefficient form, Eq. 4-16: the upper chain's 3 x 3
/// coefficient matrix inverted, the lower chain's likewise, and row selection.
JacobianResult influence_jacobian(const DeviceDescription& device, const Pose& T_device_plate,
                                  const JointAngles& joints) noexcept;

/// Smallest over largest singular value of G with rotation made commensurate by
/// a characteristic length (columns of omega divided by it). 0 at a singularity
/// or if G is not finite; at most 1.
double inverse_condition(const Jacobian& G, double characteristic_length_m = 0.05) noexcept;

}  // namespace trocar::runtime
