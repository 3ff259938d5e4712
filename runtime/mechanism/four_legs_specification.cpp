// SPDX-License-Identifier: Apache-2.0
#include "runtime/mechanism/four_legs_specification.h"

#include <numbers>

#include "formats/base/text_line.h"
#include "runtime/mechanism/jacobian.h"
#include "runtime/mechanism/kinematics.h"
#include "runtime/mechanism/torque_allocation.h"

namespace trocar::runtime {
namespace {

/// Returns the Jacobian at a pose; none: the device cannot be there.
std::optional<Jacobian> jacobian_at(const DeviceDescription& device, const Pose& T_device_plate) {
  const InverseResult inverse = inverse_kinematics(device, T_device_plate);
  if (!inverse.status) return std::nullopt;
  const JacobianResult motion = jacobian(device, T_device_plate, inverse.joints);
  if (!motion.status) return std::nullopt;
  return motion.G;
}

}  // namespace

double FourLegsSpecification::resolution() const noexcept {
  const int counts = description_.encoder_counts_per_revolution;
  return counts > 0 ? 2 * std::numbers::pi / counts : 0;
}

std::optional<Eigen::Matrix<double, 6, 6>> FourLegsSpecification::damping(
    const Pose& T_device_plate) const {
  const std::optional<Jacobian> G = jacobian_at(description_, T_device_plate);
  if (!G) return std::nullopt;
  return Eigen::Matrix<double, 6, 6>(description_.joint_viscous_friction_Nms_per_rad *
                                     G->transpose() * *G);
}

double FourLegsSpecification::renderable_share(const Pose& T_device_plate,
                                               const Wrench& wrench_device) const {
  const std::optional<Jacobian> G = jacobian_at(description_, T_device_plate);
  return G ? allocate_torques(*G, wrench_device, description_.motor_peak_torque_Nm).scale : 0;
}

std::string FourLegsSpecification::describe_demand(std::string_view what,
                                                   const Pose& T_device_plate,
                                                   const Wrench& wrench_device) const {
  const InverseResult inverse = inverse_kinematics(description_, T_device_plate);
  if (!inverse.status) return "out of the device's reach";
  const JacobianResult motion = jacobian(description_, T_device_plate, inverse.joints);
  if (!motion.status) return "at a singularity of the device";
  const AllocationResult allocation =
      allocate_torques(motion.G, wrench_device, description_.motor_peak_torque_Nm);
  return text_line("%.*s needs %.2f of %.2f Nm%s", static_cast<int>(what.size()), what.data(),
                   allocation.tau_motor_Nm.cwiseAbs().maxCoeff(), description_.motor_peak_torque_Nm,
                   allocation.scale < 1 ? ", and is then not given in full" : "");
}

}  // namespace trocar::runtime
