// SPDX-License-Identifier: Apache-2.0
// The Jacobian by the paper's influence coefficients, Eq. 4-16: the upper chain's 3 x 3 coefficient
// matrix inverted, then the lower chain's, then row selection. Independent of the compact form in
// runtime/device/four_legs/kinematics.h, with which it is compared.
#pragma once

#include "runtime/device/four_legs/kinematics.h"

namespace trocar::runtime {

/// The same as jacobian(). kSingular names the leg and motor joint of the matrix that cannot be
/// inverted.
JacobianResult influence_jacobian(const DeviceDescription& device, const Pose& T_device_plate,
                                  const JointAngles& joints) noexcept;

}  // namespace trocar::runtime
