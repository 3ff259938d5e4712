// SPDX-License-Identifier: Apache-2.0
#include "runtime/mechanism/four_legs_specification.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "formats/base/text_line.h"
#include "runtime/mechanism/jacobian.h"
#include "runtime/mechanism/kinematics.h"
#include "runtime/mechanism/singularity.h"
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

std::string describe_joint(const DeviceDescription& device, const JointAngles& joints) {
  const KinematicsStatus status = check_joint_limits(device, encoder_angles(joints));
  if (status) return {};
  const auto leg = static_cast<std::size_t>(status.leg - 1);
  const auto joint = static_cast<std::size_t>(status.joint - 1);
  const JointLimit& limit = device.joint_limit[joint];
  const double low_deg = limit.min_rad * kDegreesPerRadian,
               high_deg = limit.max_rad * kDegreesPerRadian;
  const double at_deg = joints.theta_rad[leg][joint] * kDegreesPerRadian;
  return text_line("theta%d of leg %d is at %s deg; its limits are %.1f to %.1f deg", status.joint,
                   status.leg, apart_from(at_deg, at_deg < low_deg ? low_deg : high_deg, 1).c_str(),
                   low_deg, high_deg);
}

std::string describe_singularity(const MechanismLimits& limits, const Singularity& measured) {
  if (measured.nearest_branch_m < limits.branch_distance_min_m) {
    return text_line(
        "theta%d of leg %d is %s mm from the end of its reach; the limit is %.4g mm",
        measured.nearest_joint, measured.nearest_leg,
        apart_from(measured.nearest_branch_m * 1e3, limits.branch_distance_min_m * 1e3, 2).c_str(),
        limits.branch_distance_min_m * 1e3);
  }
  if (measured.inverse_condition >= limits.inverse_condition_min) return {};
  return describe_beyond("the inverse condition is", measured.inverse_condition,
                         limits.inverse_condition_min, "", 3);
}

}  // namespace

std::string FourLegsSpecification::describe_strength() const {
  return text_line("%.3g Nm peak a motor", description_.motor_peak_torque_Nm);
}

MotorsAndJoints FourLegsSpecification::motors_and_joints() const {
  MotorsAndJoints out{
      description_.motor_peak_torque_Nm, description_.motor_continuous_torque_Nm, {}};
  for (const JointLimit& limit : description_.joint_limit)
    out.joint_limits_rad.push_back({limit.min_rad, limit.max_rad});
  return out;
}

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

double FourLegsSpecification::renderable_fraction(const Pose& T_device_plate,
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

DeviceMargins FourLegsSpecification::margins(const Pose& T_device_plate) const noexcept {
  constexpr DeviceMargins kUnreachable{.fault = Fault::kPoseResidual, .is_reachable = false};
  const InverseResult inverse = inverse_kinematics(description_, T_device_plate);
  if (!inverse.status) return kUnreachable;
  const JacobianResult motion = jacobian(description_, T_device_plate, inverse.joints);
  if (!motion.status) return kUnreachable;
  DeviceMargins out;
  const std::array<double, kEncoders> encoder_rad = encoder_angles(inverse.joints);
  for (std::size_t i = 0; i < encoder_rad.size(); ++i) {
    const JointLimit& limit = description_.joint_limit[i % 4];
    const double margin_rad =
        std::min(encoder_rad[i] - limit.min_rad, limit.max_rad - encoder_rad[i]);
    if (!(margin_rad < out.joint_rad)) continue;
    out.joint_rad = margin_rad;
    out.joint = static_cast<int>(i);
  }
  const Singularity singularity =
      measure_singularity(description_, T_device_plate, inverse.joints, motion.G);
  out.inverse_condition = singularity.inverse_condition;
  out.fault = check_joint_limits(description_, encoder_rad)
                  ? Fault{check_singularity(limits_, singularity)}
                  : Fault::kJointLimit;
  return out;
}

std::string FourLegsSpecification::describe_margins(const DeviceMargins& smallest) const {
  return text_line("theta%d of leg %d %.1f deg %s its limit; inverse condition at least %.3f",
                   smallest.joint % 4 + 1, smallest.joint / 4 + 1,
                   std::abs(smallest.joint_rad) * kDegreesPerRadian,
                   smallest.joint_rad < 0 ? "beyond" : "from", smallest.inverse_condition);
}

std::string FourLegsSpecification::describe_fault(Fault fault, const Pose& T_device_plate) const {
  const InverseResult inverse = inverse_kinematics(description_, T_device_plate);
  const auto unreachable = [&](const KinematicsStatus& status) {
    return fault != Fault::kPoseResidual ? std::string()
                                         : text_line("theta%d of leg %d is %s", status.joint,
                                                     status.leg, to_string(status.failure));
  };
  if (!inverse.status) return unreachable(inverse.status);
  if (fault == Fault::kJointLimit) return describe_joint(description_, inverse.joints);
  const JacobianResult motion = jacobian(description_, T_device_plate, inverse.joints);
  if (!motion.status) return unreachable(motion.status);
  if (fault != Fault::kSingularity) return {};
  return describe_singularity(
      limits_, measure_singularity(description_, T_device_plate, inverse.joints, motion.G));
}

std::optional<Pose> FourLegsSpecification::pose_of(const RecordingRow& row) const {
  const ForwardResult forward = forward_kinematics(description_, row.encoder_rad);
  return forward.status ? std::optional(forward.T_device_plate) : std::nullopt;
}

}  // namespace trocar::runtime
