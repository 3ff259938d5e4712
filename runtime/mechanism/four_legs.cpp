// SPDX-License-Identifier: Apache-2.0
#include "runtime/mechanism/four_legs.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

namespace trocar::runtime {
namespace {

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

DeviceStatus FourLegs::read(double& t_s) noexcept {
  DeviceState state{last_.t_s, last_.value};
  const DeviceStatus status = device_.read(state);
  reading_.t_s = state.t_s;
  reading_.value = state.encoder_rad;
  if (status == DeviceStatus::kOk) t_s = state.t_s;
  return status;
}

void FourLegs::use_last_reading() noexcept {
  reading_ = last_;
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
        limits_.encoder_rate_max_rad_per_s * interval.step_s + specification_.resolution();
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
  if (allocation.kind == AllocationKind::kRefused) {
    return input.wanted.allFinite() ? FaultDetail(Fault::kSingularity) : not_finite(input.wanted);
  }
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

void FourLegs::stop() noexcept {
  at_stop_Nm_ = written_Nm_;
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

Wrench FourLegs::delivered() const noexcept {
  return G_.transpose() * (written_Nm_ - compensation_Nm_);
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
