// SPDX-License-Identifier: Apache-2.0
#include "runtime/device/four_legs/four_legs.h"

#include "formats/base/text.h"

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

/// After kMotorOverload, recovery waits until the i2t state of every motor is at most this fraction
/// of its limit.
constexpr double kMaxHeatToRecover = 0.5;

FaultDetail not_finite(const Wrench& wanted) noexcept {
  int i = 0;
  while (i < 5 && std::isfinite(wanted[i]))
    ++i;
  return {Fault::kTorqueNotFinite, FaultQuantity::kWantedWrench, i, wanted[i],
          std::numeric_limits<double>::quiet_NaN()};
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

double FourLegsSpecification::encoder_count_rad() const noexcept {
  const int counts = description_.encoder_counts_per_revolution;
  return counts > 0 ? 2 * std::numbers::pi / counts : 0;
}

DeviceReadings FourLegsSpecification::readings() const noexcept {
  const double link_m = description_.geometry.l1_m, radius_m = description_.geometry.R_T_m;
  const double noise_m = description_.encoder_noise_rad * link_m,
               resolution_m = encoder_count_rad() * link_m;
  return {noise_m, resolution_m, noise_m / radius_m, resolution_m / radius_m,
          description_.delay_s.value_or(0)};
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

DeviceStatus FourLegs::read(double& t_s) noexcept {
  DeviceState state{last_.t_s, last_.value};
  const DeviceStatus status = device_.read(state);
  reading_.t_s = state.t_s;
  reading_.value = state.encoder_rad;
  if (status == DeviceStatus::kOk) t_s = state.t_s;
  return status;
}

bool FourLegs::keep_reading() noexcept {
  const bool is_finite = std::all_of(reading_.value.begin(), reading_.value.end(),
                                     [](double angle) { return std::isfinite(angle); });
  if (is_finite) last_ = reading_;
  return is_finite;
}

FaultDetail FourLegs::check_encoders(const ReadingInterval& interval) const noexcept {
  constexpr double kAnyFinite = std::numeric_limits<double>::quiet_NaN();
  const std::array<double, kEncoders>& encoder_rad = reading_.value;
  for (int i = 0; i < kEncoders; ++i) {
    if (!std::isfinite(encoder_rad[i])) {
      return {Fault::kEncoderNotFinite, FaultQuantity::kEncoderAngle, i, encoder_rad[i],
              kAnyFinite};
    }
  }
  if (interval.has_last) {
    // At rest two readings may still differ by a count.
    const double step_max_rad =
        limits_.encoder_rate_max_rad_per_s * interval.step_s + specification_.encoder_count_rad();
    for (int i = 0; i < kEncoders; ++i) {
      const double step_rad = std::abs(encoder_rad[i] - last_.value[i]);
      if (!(step_rad <= step_max_rad)) {  // negated so that a limit of nan always trips
        return {Fault::kEncoderJump, FaultQuantity::kEncoderStep, i, step_rad, step_max_rad};
      }
    }
  }
  const KinematicsStatus inside = check_joint_limits(description(), encoder_rad);
  if (inside) return Fault::kNone;
  const int i = 4 * (inside.leg - 1) + inside.joint - 1;
  const JointLimit& limit = description().joint_limit[inside.joint - 1];
  return {Fault::kJointLimit, FaultQuantity::kEncoderAngle, i, encoder_rad[i],
          encoder_rad[i] > limit.max_rad ? limit.max_rad : limit.min_rad};
}

FaultDetail FourLegs::find_pose(const ReadingInterval& interval, PlatePose& pose) noexcept {
  if (const FaultDetail f = check_encoders(interval); f != Fault::kNone) return f;
  const DeviceDescription& device = description();
  const ForwardResult forward = forward_kinematics(device, reading_.value);
  if (!forward.status) return Fault::kPoseResidual;
  if (!(forward.residual_m <= limits_.pose_residual_max_m)) {
    return {Fault::kPoseResidual, FaultQuantity::kPoseResidual, -1, forward.residual_m,
            limits_.pose_residual_max_m};
  }
  const InverseResult inverse = inverse_kinematics(device, forward.T_device_plate);
  if (!inverse.status) return Fault::kPoseResidual;
  const MotorVector difference = motor_angles(inverse.joints) - motor_angles(reading_.value);
  for (int motor = 1; motor < kMotors; motor += 2) {
    if (!(std::abs(difference[motor]) <= limits_.theta4_residual_max_rad)) {
      return {Fault::kPoseResidual, FaultQuantity::kEncoderResidual, 2 * motor + 1,
              std::abs(difference[motor]), limits_.theta4_residual_max_rad};
    }
  }
  const JacobianResult motion = jacobian(device, forward.T_device_plate, inverse.joints);
  if (!motion.status) {
    return {Fault::kSingularity, FaultQuantity::kBranchDistance, motion.status.leg - 1, 0,
            limits_.branch_distance_min_m};
  }
  const Singularity singularity =
      measure_singularity(device, forward.T_device_plate, inverse.joints, motion.G);
  if (const FaultDetail f = check_singularity(limits_, singularity); f != Fault::kNone) return f;
  pose = {forward.T_device_plate, forward.residual_m};
  G_ = motion.G;
  return Fault::kNone;
}

FaultDetail FourLegs::fault_of(DeviceStatus status) const noexcept {
  const unsigned motors = status == DeviceStatus::kMotorFault ? device_.fault_byte() : 0U;
  if (motors != 0)
    return {Fault::kMotorFault, FaultQuantity::kMotor, std::countr_zero(motors), 0, 0};
  return HandDevice::fault_of(status);
}

FaultDetail FourLegs::account_held_time(double held_s) noexcept {
  return check_heat(motor_, written_Nm_, held_s, motors_);
}

FaultDetail FourLegs::check_rested() const noexcept {
  return check_motor_heat(motor_, motors_.load, kMaxHeatToRecover);
}

MotorVector FourLegs::compensation(const RenderInput& input) noexcept {
  compensation_authority_ = std::min(1.0, compensation_authority_ + input.authority_rise);
  const MotorVector rate_rad_per_s = G_ * input.twist_device;
  return compensation_authority_ *
         compensation_torques(description(), motor_, G_, rate_rad_per_s, input.compensation);
}

FaultDetail FourLegs::render(const RenderInput& input, double& scale) noexcept {
  const MotorVector limit_Nm = available_torque(motor_, motors_.load);
  const bool compensates = input.compensation.friction || input.compensation.gravity;
  const MotorVector compensation_Nm = compensates ? compensation(input) : MotorVector::Zero();
  int weakest = 0;
  if (!((limit_Nm - compensation_Nm.cwiseAbs()).minCoeff(&weakest) > 0)) {
    return {Fault::kMotorOverload, FaultQuantity::kCompensationTorque, weakest,
            std::abs(compensation_Nm[weakest]), limit_Nm[weakest]};
  }
  const AllocationResult allocation =
      compensates ? allocate_torques_with_bias(G_, input.wanted, limit_Nm, compensation_Nm)
                  : allocate_torques(G_, input.wanted, limit_Nm);
  if (allocation.kind == AllocationKind::kRefused)
    return input.wanted.allFinite() ? FaultDetail(Fault::kSingularity) : not_finite(input.wanted);
  const FaultDetail overload =
      check_overload(limits_, motor_, allocation.scale, input.dt_s, motors_);
  if (overload != Fault::kNone) return overload;
  MotorVector tau_Nm = allocation.tau_motor_Nm;
  const FaultDetail limited =
      limit_torques(limits_, limit_Nm, written_Nm_, input.dt_s, tau_Nm, motors_);
  if (limited != Fault::kNone) return limited;
  next_Nm_ = tau_Nm;
  compensation_Nm_ = compensation_Nm;
  scale = allocation.scale;
  return Fault::kNone;
}

void FourLegs::fade(double share) noexcept {
  next_Nm_ = share * at_stop_Nm_;
  motors_.rise_s = motors_.overload_s = 0;
  compensation_Nm_.setZero();
  compensation_authority_ = 0;
}

DeviceStatus FourLegs::write() noexcept {
  DeviceCommand command;
  std::copy(next_Nm_.data(), next_Nm_.data() + kMotors, command.tau_motor_Nm.begin());
  written_Nm_ = next_Nm_;
  return device_.write(command);
}

void FourLegs::describe(RecordingRow& row, DeviceReadout& readout) const noexcept {
  row.encoder_rad = reading_.value;
  row.state_t_s = reading_.t_s;
  std::copy(written_Nm_.data(), written_Nm_.data() + kMotors, row.tau_Nm.begin());
  row.motor_heat_max = i2t_fraction_used(motor_, motors_.load);
  const MotorVector limit_Nm = available_torque(motor_, motors_.load);
  std::copy(limit_Nm.data(), limit_Nm.data() + kMotors, readout.command_limit.begin());
  readout.margin = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < reading_.value.size(); ++i) {
    const JointLimit& limit = description().joint_limit.at(i % 4);
    readout.margin = std::min({readout.margin, reading_.value.at(i) - limit.min_rad,
                               limit.max_rad - reading_.value.at(i)});
  }
}

}  // namespace trocar::runtime
