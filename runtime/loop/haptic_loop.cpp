// SPDX-License-Identifier: Apache-2.0
#include "runtime/loop/haptic_loop.h"

#include <algorithm>
#include <cmath>

namespace trocar::runtime {
namespace {

Fault read_device(const LoopModel& model, Device& device, LoopState& state, TickResult& result,
                  DeviceState& read, bool& fresh) noexcept {
  read = state.device;
  fresh = false;
  switch (device.read(read)) {
    case DeviceStatus::kOk:
      fresh = true;
      return Fault::kNone;
    case DeviceStatus::kNoData:
      read = state.device;
      return ++state.no_data_ticks > model.limits.no_data_ticks_max ? Fault::kNoData : Fault::kNone;
    case DeviceStatus::kEndOfData:
      result.end_of_data = true;
      return Fault::kNone;
    case DeviceStatus::kEmergencyStop:
      return Fault::kEmergencyStop;
    case DeviceStatus::kMotorFault:
      return Fault::kMotorFault;
    case DeviceStatus::kLinkLost:
      break;
  }
  read = state.device;
  return Fault::kLinkLost;
}

Fault check_encoders(const LoopModel& model, const LoopState& state,
                     const DeviceState& read) noexcept {
  for (const double angle : read.encoder_rad) {
    if (!std::isfinite(angle)) return Fault::kEncoderNotFinite;
  }
  if (state.has_state) {
    const double step_max_rad =
        model.limits.encoder_rate_max_rad_per_s * (1 + state.no_data_ticks) / model.rate_Hz;
    for (int i = 0; i < kEncoders; ++i) {
      if (std::abs(read.encoder_rad[i] - state.device.encoder_rad[i]) > step_max_rad) {
        return Fault::kEncoderJump;
      }
    }
  }
  return check_joint_limits(model.device, read.encoder_rad) ? Fault::kNone : Fault::kJointLimit;
}

/// The pose and what the torques need of it. The lower chains' passive joints and theta4 follow
/// from the pose, so the measured theta4 are a check of their own.
Fault find_pose(const LoopModel& model, const DeviceState& read, Pose& T_device_plate, Jacobian& G,
                double& residual_m) noexcept {
  const ForwardResult forward = forward_kinematics(model.device, read.encoder_rad);
  if (!forward.status || !(forward.residual_m <= model.limits.pose_residual_max_m)) {
    return Fault::kPoseResidual;
  }
  const InverseResult inverse = inverse_kinematics(model.device, forward.T_device_plate);
  if (!inverse.status) return Fault::kPoseResidual;
  const MotorVector difference = motor_angles(inverse.joints) - motor_angles(read.encoder_rad);
  for (int motor = 1; motor < kMotors; motor += 2) {
    if (!(std::abs(difference[motor]) <= model.limits.theta4_residual_max_rad)) {
      return Fault::kPoseResidual;
    }
  }
  const JacobianResult motion = jacobian(model.device, forward.T_device_plate, inverse.joints);
  if (!motion.status || !(inverse_condition(motion.G) >= model.limits.inverse_condition_min)) {
    return Fault::kSingularity;
  }
  T_device_plate = forward.T_device_plate;
  G = motion.G;
  residual_m = forward.residual_m;
  return Fault::kNone;
}

void put_wrench(const Wrench& wrench, std::array<double, 6>& out) noexcept {
  std::copy(wrench.data(), wrench.data() + 6, out.begin());
}

/// The part of the row that is known whatever the tick's outcome.
void describe_pose(const LoopModel& model, const LoopState& state, const DeviceState& read,
                   RecordingRow& row) noexcept {
  const Pose& pose = state.T_device_plate;
  const Eigen::Vector3d tip = pose * model.contact.tool.tip_plate_m;
  row.p_m = {pose.p_m.x(), pose.p_m.y(), pose.p_m.z()};
  row.q = {pose.q.w(), pose.q.x(), pose.q.y(), pose.q.z()};
  row.tool_m = {tip.x(), tip.y(), tip.z()};
  row.encoder_rad = read.encoder_rad;
}

/// Pose, contact, allocation, limits. On a fault neither torques nor `state` have changed, but for
/// what the contact has seen.
Fault compute_torques(const LoopModel& model, const TickInputs& inputs, const DeviceState& read,
                      LoopState& state, TickResult& result, MotorVector& tau_motor_Nm) noexcept {
  RecordingRow& row = result.row;
  if (const Fault fault = check_encoders(model, state, read); fault != Fault::kNone) return fault;
  if (const Fault fault =
          find_pose(model, read, state.T_device_plate, state.G, row.pose_residual_m);
      fault != Fault::kNone) {
    return fault;
  }

  update_contact(model.contact, inputs.sheets, inputs.response, state.T_device_plate, state.contact,
                 result.contact);
  if (result.contact.not_upright) return Fault::kToolTilt;
  if (result.contact.backlog) return Fault::kRemeshBacklog;
  const Wrench& wanted = result.contact.wrench_device;
  // A passivity controller takes and returns `wanted` here.

  const AllocationResult allocation =
      allocate_torques(state.G, wanted, model.device.motor_peak_torque_Nm);
  if (allocation.kind == Allocation::kRefused) {
    return wanted.allFinite() ? Fault::kSingularity : Fault::kTorqueNotFinite;
  }
  bool shortened = false;
  tau_motor_Nm = limit_rise(state.tau_motor_Nm, allocation.tau_motor_Nm,
                            model.limits.torque_rise_max_Nm_per_s / model.rate_Hz, shortened);
  if (!tau_motor_Nm.allFinite()) return Fault::kTorqueNotFinite;
  // Between two torques within the limit only rounding can leave it.
  const double peak_Nm = model.device.motor_peak_torque_Nm;
  tau_motor_Nm = tau_motor_Nm.cwiseMax(-peak_Nm).cwiseMin(peak_Nm);

  row.phase = result.contact.phase;
  row.active_slice = result.contact.active_sheet < 0
                         ? -1
                         : inputs.sheets[result.contact.active_sheet]->slice_index;
  row.penetration_m = result.contact.penetration_m;
  row.wrench_scale = allocation.scale;
  put_wrench(wanted, row.wrench_wanted);
  return Fault::kNone;
}

}  // namespace

MotorVector limit_rise(const MotorVector& last, const MotorVector& wanted, double rise_max_Nm,
                       bool& shortened) noexcept {
  shortened = false;
  const double step_Nm = (wanted - last).cwiseAbs().maxCoeff();
  const bool grows = wanted.cwiseAbs().maxCoeff() > last.cwiseAbs().maxCoeff();
  if (!grows || step_Nm <= rise_max_Nm) return wanted;
  shortened = true;
  return last + (rise_max_Nm / step_Nm) * (wanted - last);
}

void haptic_tick(const LoopModel& model, const TickInputs& inputs, Device& device, LoopState& state,
                 TickResult& result) noexcept {
  result = TickResult{};
  RecordingRow& row = result.row;
  row.t_s = static_cast<double>(state.tick) / model.rate_Hz;
  row.response_sheet = inputs.response.sheet;
  row.response_stiffness_N_per_m = inputs.response.stiffness_N_per_m;
  row.response_offset_m = inputs.response.offset_m;

  DeviceState read;
  bool fresh = false;
  Fault fault = read_device(model, device, state, result, read, fresh);
  if (result.end_of_data) return;
  if (fault == Fault::kNone && model.limits.gap_max_s > 0 &&
      inputs.gap_s > model.limits.gap_max_s) {
    fault = Fault::kDeadlineMissed;
  }

  MotorVector tau_motor_Nm = MotorVector::Zero();
  const bool blind = !state.has_state && state.no_data_ticks > 0;  // nothing was ever read
  if (state.fault == Fault::kNone && fault == Fault::kNone && !blind) {
    fault = compute_torques(model, inputs, read, state, result, tau_motor_Nm);
    if (fault == Fault::kNone && fresh) {
      state.device = read;
      state.has_state = true;
      state.no_data_ticks = 0;
    }
  }
  if (state.fault == Fault::kNone && fault != Fault::kNone) {
    state.fault = fault;
    state.fault_t_s = row.t_s;
    state.tau_at_fault_Nm = state.tau_motor_Nm;
  }
  if (state.fault != Fault::kNone) {
    const double left =
        1 - static_cast<double>(++state.ramp_ticks_done) / (model.limits.ramp_s * model.rate_Hz);
    tau_motor_Nm = std::max(left, 0.0) * state.tau_at_fault_Nm;
    result.ramp_done = left <= 0;
    row.phase = ContactPhase::kFault;
  }

  DeviceCommand command;
  std::copy(tau_motor_Nm.data(), tau_motor_Nm.data() + kMotors, command.tau_motor_Nm.begin());
  const DeviceStatus written = device.write(command);
  if (written != DeviceStatus::kOk && state.fault == Fault::kNone) {
    // The device may or may not have taken these torques; the ramp starts from them.
    state.fault = written == DeviceStatus::kLinkLost ? Fault::kLinkLost : Fault::kWriteFailed;
    state.fault_t_s = row.t_s;
    state.tau_at_fault_Nm = tau_motor_Nm;
    row.phase = ContactPhase::kFault;
  }
  state.tau_motor_Nm = tau_motor_Nm;

  describe_pose(model, state, read, row);
  put_wrench(state.G.transpose() * tau_motor_Nm, row.wrench_delivered);
  row.tau_Nm = command.tau_motor_Nm;
  row.fault = state.fault;
  ++state.tick;
}

}  // namespace trocar::runtime
