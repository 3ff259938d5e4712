// SPDX-License-Identifier: Apache-2.0
#include "runtime/control/haptic_loop.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>

namespace trocar::runtime {
namespace {

/// After kMotorOverload, recovery waits until the i2t state of every motor is at most this fraction
/// of its limit.
constexpr double kMaxHeatToRecover = 0.5;

/// Returns the fault for a status other than kOk and kNoData.
FaultDetail fault_of(DeviceStatus status, const Device& device) noexcept {
  if (status == DeviceStatus::kEmergencyStop) return Fault::kEmergencyStop;
  if (status != DeviceStatus::kMotorFault) return Fault::kLinkLost;
  const unsigned motors = device.motor_faults();
  if (motors == 0) return Fault::kMotorFault;
  return {Fault::kMotorFault, FaultQuantity::kMotor, std::countr_zero(motors), 0, 0};
}

/// Returns the angle of one encoder count; 0: the encoders are exact.
double encoder_count_rad(const DeviceDescription& device) noexcept {
  const int counts = device.encoder_counts_per_revolution;
  return counts > 0 ? 2 * std::numbers::pi / counts : 0;
}

/// Sets pose_interval_s (contract 4). Returns false if the device state is not new.
bool take_time(const LoopModel& model, double t_s, LoopState& state, FaultDetail& fault) noexcept {
  if (!std::isfinite(t_s)) return false;
  // Both time stamps are whole nanoseconds (device_link.md).
  const double since_s = state.has_state ? std::round((t_s - state.device.t_s) * 1e9) / 1e9 : 0;
  const bool too_long = model.limits.gap_max_s != 0 && !(since_s <= model.limits.gap_max_s);
  if (since_s > 0 && !too_long) {
    const double ticks_s = (1 + state.no_data_ticks) / model.rate_Hz;
    state.pose_interval_s = since_s;
    state.ahead_s = std::max(-model.limits.no_data_max_s, state.ahead_s + since_s - ticks_s);
    return true;
  }
  if (state.safety.state == SafetyState::kRunning) {
    if (since_s > 0) {
      fault = {Fault::kNoData, FaultQuantity::kTimeWithoutData, -1, since_s,
               model.limits.gap_max_s};
    }
    return since_s > 0;
  }
  state.limits.has_pose = false;
  state.window.clear();
  state.ahead_s = 0;
  return true;
}

/// Fills `read` with the new device state; if there is none, with the last one, and sets `fresh` to false.
FaultDetail read_device(const LoopModel& model, Device& device, LoopState& state,
                        TickResult& result, DeviceState& read, bool& fresh) noexcept {
  FaultDetail fault;
  state.pose_interval_s = 0;
  read = state.device;
  DeviceStatus status = device.read(read);
  result.end_of_data = status == DeviceStatus::kEndOfData;
  if (status == DeviceStatus::kOk && !take_time(model, read.t_s, state, fault)) {
    status = DeviceStatus::kNoData;
  }
  if (!result.end_of_data) result.row.device_read = status;
  fresh = status == DeviceStatus::kOk;
  if (fresh || result.end_of_data) return fault;
  read = state.device;
  ++state.no_data_ticks;
  if (status != DeviceStatus::kNoData) return fault_of(status, device);
  // Half a tick allows for rounding, so that 10 ms are ten ticks at 1 kHz.
  const double no_data_s = static_cast<double>(state.no_data_ticks) / model.rate_Hz;
  if (no_data_s < model.limits.no_data_max_s - 0.5 / model.rate_Hz) return {};
  return {Fault::kNoData, FaultQuantity::kTimeWithoutData, -1, no_data_s,
          model.limits.no_data_max_s};
}

/// Returns a fault of the clock, or one that the caller found.
FaultDetail outside_fault(const SafetyLimits& limits, const TickInputs& inputs) noexcept {
  if (inputs.outside != Fault::kNone) return inputs.outside;
  if (limits.gap_max_s == 0) return Fault::kNone;
  if (!(inputs.gap_s <= limits.gap_max_s)) {  // nan is late
    return {Fault::kDeadlineMissed, FaultQuantity::kTickGap, -1, inputs.gap_s, limits.gap_max_s};
  }
  if (inputs.missed_in_row <= limits.missed_deadlines_max) return Fault::kNone;
  return {Fault::kDeadlineMissed, FaultQuantity::kMissedDeadlines, -1,
          static_cast<double>(inputs.missed_in_row),
          static_cast<double>(limits.missed_deadlines_max)};
}

FaultDetail check_encoders(const LoopModel& model, const LoopState& state,
                           const DeviceState& read) noexcept {
  constexpr double kAnyFinite = std::numeric_limits<double>::quiet_NaN();
  for (int i = 0; i < kEncoders; ++i) {
    if (!std::isfinite(read.encoder_rad[i])) {
      return {Fault::kEncoderNotFinite, FaultQuantity::kEncoderAngle, i, read.encoder_rad[i],
              kAnyFinite};
    }
  }
  if (state.has_state) {
    // The allowed step depends on the time on the device's clock, but on at most the time of the counted
    // ticks or no_data_max_s, whichever is longer. At rest two readings may still differ by a count.
    const double ticks_s = (1 + state.no_data_ticks) / model.rate_Hz;
    const double interval_s =
        state.pose_interval_s > 0
            ? std::min(state.pose_interval_s, std::max(ticks_s, model.limits.no_data_max_s))
            : ticks_s;
    const double step_max_rad =
        model.limits.encoder_rate_max_rad_per_s * interval_s + encoder_count_rad(model.device);
    for (int i = 0; i < kEncoders; ++i) {
      const double step_rad = std::abs(read.encoder_rad[i] - state.device.encoder_rad[i]);
      if (!(step_rad <= step_max_rad)) {  // negated so that a limit of nan always trips
        return {Fault::kEncoderJump, FaultQuantity::kEncoderStep, i, step_rad, step_max_rad};
      }
    }
  }
  const KinematicsStatus inside = check_joint_limits(model.device, read.encoder_rad);
  if (inside) return Fault::kNone;
  const int i = 4 * (inside.leg - 1) + inside.joint - 1;
  const JointLimit& limit = model.device.joint_limit[inside.joint - 1];
  return {Fault::kJointLimit, FaultQuantity::kEncoderAngle, i, read.encoder_rad[i],
          read.encoder_rad[i] > limit.max_rad ? limit.max_rad : limit.min_rad};
}

/// Computes the pose and the Jacobian. The pose is fitted to the upper chains. The joints of the lower
/// chains, with theta4, follow from it, so comparing theta4 with the measured theta4 is a further check.
FaultDetail find_pose(const LoopModel& model, const DeviceState& read, LoopState& state,
                      double& residual_m) noexcept {
  const ForwardResult forward = forward_kinematics(model.device, read.encoder_rad);
  if (!forward.status) return Fault::kPoseResidual;
  if (!(forward.residual_m <= model.limits.pose_residual_max_m)) {
    return {Fault::kPoseResidual, FaultQuantity::kPoseResidual, -1, forward.residual_m,
            model.limits.pose_residual_max_m};
  }
  const InverseResult inverse = inverse_kinematics(model.device, forward.T_device_plate);
  if (!inverse.status) return Fault::kPoseResidual;
  const MotorVector difference = motor_angles(inverse.joints) - motor_angles(read.encoder_rad);
  for (int motor = 1; motor < kMotors; motor += 2) {
    if (!(std::abs(difference[motor]) <= model.limits.theta4_residual_max_rad)) {
      return {Fault::kPoseResidual, FaultQuantity::kEncoderResidual, 2 * motor + 1,
              std::abs(difference[motor]), model.limits.theta4_residual_max_rad};
    }
  }
  const JacobianResult motion = jacobian(model.device, forward.T_device_plate, inverse.joints);
  if (!motion.status) {
    return {Fault::kSingularity, FaultQuantity::kBranchDistance, motion.status.leg - 1, 0,
            model.limits.branch_distance_min_m};
  }
  const Singularity singularity =
      measure_singularity(model.device, forward.T_device_plate, inverse.joints, motion.G);
  if (const FaultDetail f = check_singularity(model.limits, singularity); f != Fault::kNone)
    return f;
  state.T_device_plate = forward.T_device_plate;
  state.G = motion.G;
  residual_m = forward.residual_m;
  return Fault::kNone;
}

FaultDetail tool_tilt(const Tool& tool, const Pose& T_device_plate) noexcept {
  const double upright = (T_device_plate.q * tool.axis_plate).z();
  return {Fault::kToolTilt, FaultQuantity::kToolTilt, -1, std::acos(std::clamp(upright, -1.0, 1.0)),
          kMaxTilt_deg * std::numbers::pi / 180};
}

/// Runs all checks that need no torque. They are the same in every safety state.
FaultDetail check_health(const LoopModel& model, const DeviceState& read, bool fresh,
                         LoopState& state, TickResult& result) noexcept {
  if (const FaultDetail f = check_encoders(model, state, read); f != Fault::kNone) return f;
  if (const FaultDetail f = find_pose(model, read, state, result.row.pose_residual_m);
      f != Fault::kNone) {
    return f;
  }
  if (fresh) {
    const double interval_s =
        state.pose_interval_s > 0 ? state.pose_interval_s : 1 / model.rate_Hz;  // the first pose
    const FaultDetail speed =
        check_speed(model.limits, state.T_device_plate, interval_s, state.limits);
    if (speed != Fault::kNone) return speed;
  }
  if (const FaultDetail f = check_workspace(model.limits, state.T_device_plate);
      f != Fault::kNone) {
    return f;
  }
  return is_upright(model.tool, state.T_device_plate) ? FaultDetail()
                                                      : tool_tilt(model.tool, state.T_device_plate);
}

void put_wrench(const Wrench& wrench, std::array<double, 6>& out) noexcept {
  std::copy(wrench.data(), wrench.data() + 6, out.begin());
}

FaultDetail not_finite(const Wrench& wanted) noexcept {
  int i = 0;
  while (i < 5 && std::isfinite(wanted[i]))
    ++i;
  return {Fault::kTorqueNotFinite, FaultQuantity::kWantedWrench, i, wanted[i],
          std::numeric_limits<double>::quiet_NaN()};
}

/// Computes the wrench to render: the force law's wrench, multiplied by Safety::authority and made passive.
FaultDetail wanted_wrench(const LoopModel& model, const TickInputs& inputs, ForceLaw& law,
                          LoopState& state, ContactOutput& contact, Wrench& wanted) noexcept {
  const ForceLawInput input{inputs.sheets, inputs.prefetched, state.T_device_plate,
                            state.pose_interval_s, state.previous};
  const FaultDetail refused = law.update(input, contact);
  if (refused != Fault::kNone) return refused;
  if (contact.not_upright) return tool_tilt(model.tool, contact.T_device_evaluated);
  if (contact.backlog) {
    return {Fault::kRemeshBacklog, FaultQuantity::kWaitingHoles, -1, kMaxPendingHoles + 1,
            kMaxPendingHoles};
  }
  const FaultDetail energy = state.energy.check(
      model.limits, model.rate_Hz,
      {state.T_device_plate, state.pose_interval_s > 0, contact.stored_J, contact.is_released});
  if (energy != Fault::kNone) return energy;

  PassivityOptions passivity = model.passivity;
  if (law.is_passive()) {  // the energy is only observed
    passivity.on = false;
    passivity.credit_max_J = std::numeric_limits<double>::infinity();
  }
  PassivityInput rendered;
  rendered.T_device_plate = state.T_device_plate;
  rendered.previous = state.previous;
  rendered.wrench_device = state.safety.authority * contact.wrench_plate;
  rendered.stored_J = state.safety.authority * contact.stored_J;
  rendered.planned_release = contact.is_released;
  wanted = keep_passive(passivity, model.device.plate_mass_kg, state.pose_interval_s, rendered,
                        state.passivity);
  return Fault::kNone;
}

/// Returns the torques that cancel the device's friction and weight. They rise from zero
/// after `running` begins.
MotorVector compensation(const LoopModel& model, const MotorModel& motor,
                         LoopState& state) noexcept {
  state.compensation_authority = std::min(
      1.0, state.compensation_authority + rise_per_tick(model.limits.timing, model.rate_Hz));
  const MotorVector rate_rad_per_s = state.G * state.limits.twist_device;
  return state.compensation_authority *
         compensation_torques(model.device, motor, state.G, rate_rad_per_s, model.compensation);
}

/// Computes the wrench of the contact, allocates torques, and limits them.
FaultDetail compute_torques(const LoopModel& model, const MotorModel& motor,
                            const TickInputs& inputs, ForceLaw& law, LoopState& state,
                            TickResult& result, MotorVector& tau_motor_Nm) noexcept {
  RecordingRow& row = result.row;
  Wrench wanted = Wrench::Zero();
  const FaultDetail found = wanted_wrench(model, inputs, law, state, result.contact, wanted);
  if (found != Fault::kNone) return found;
  const double dt_s = 1 / model.rate_Hz;
  const MotorVector limit_Nm = available_torque(motor, state.limits.load);
  const bool compensates = model.compensation.friction || model.compensation.gravity;
  const MotorVector compensation_Nm =
      compensates ? compensation(model, motor, state) : MotorVector::Zero();
  int weakest = 0;
  if (!((limit_Nm - compensation_Nm.cwiseAbs()).minCoeff(&weakest) > 0)) {
    return {Fault::kMotorOverload, FaultQuantity::kCompensationTorque, weakest,
            std::abs(compensation_Nm[weakest]), limit_Nm[weakest]};
  }
  const AllocationResult allocation =
      compensates ? allocate_torques_with_bias(state.G, wanted, limit_Nm, compensation_Nm)
                  : allocate_torques(state.G, wanted, limit_Nm);
  if (allocation.kind == AllocationKind::kRefused) {
    return wanted.allFinite() ? FaultDetail(Fault::kSingularity) : not_finite(wanted);
  }
  const FaultDetail overload =
      check_overload(model.limits, motor, allocation.scale, dt_s, state.limits);
  if (overload != Fault::kNone) return overload;
  MotorVector tau = allocation.tau_motor_Nm;
  const FaultDetail limited =
      limit_torques(model.limits, limit_Nm, state.tau_motor_Nm, dt_s, tau, state.limits);
  if (limited != Fault::kNone) return limited;
  tau_motor_Nm = tau;
  state.compensation_Nm = compensation_Nm;

  row.phase = result.contact.phase;
  row.active_slice = result.contact.active_sheet < 0
                         ? -1
                         : inputs.sheets[result.contact.active_sheet]->slice_index;
  row.penetration_m = result.contact.penetration_m;
  row.wrench_scale = allocation.scale;
  put_wrench(wanted, row.wrench_wanted);
  return Fault::kNone;
}

/// Returns the wrench rendered to the hand, without compensation torques, which only cancel the
/// device's own forces.
Wrench rendered_wrench(const LoopState& state) noexcept {
  return state.G.transpose() * (state.tau_motor_Nm - state.compensation_Nm);
}

/// Fills the columns that do not depend on the tick's outcome.
void describe(const LoopModel& model, const MotorModel& motor, const LoopState& state,
              const DeviceState& read, RecordingRow& row) noexcept {
  const Pose& pose = state.T_device_plate;
  const Eigen::Vector3d tip = pose * model.tool.tip_plate_m;
  row.p_m = {pose.p_m.x(), pose.p_m.y(), pose.p_m.z()};
  row.q = {pose.q.w(), pose.q.x(), pose.q.y(), pose.q.z()};
  row.tool_m = {tip.x(), tip.y(), tip.z()};
  row.encoder_rad = read.encoder_rad;
  row.state_t_s = read.t_s;
  std::copy(state.tau_motor_Nm.data(), state.tau_motor_Nm.data() + kMotors, row.tau_Nm.begin());
  put_wrench(rendered_wrench(state), row.wrench_delivered);
  row.safety = state.safety.state;
  row.fault = state.safety.fault;
  const bool stopped = row.safety == SafetyState::kFault || row.safety == SafetyState::kRecovering;
  if (stopped) row.phase = ContactPhase::kFault;
  row.authority = row.safety == SafetyState::kRunning ? state.safety.authority : 0;
  row.passivity_J = state.passivity.balance_J;
  row.passivity_N_s_per_m = state.passivity.damping_N_s_per_m;
  row.motor_heat_max = i2t_fraction_used(motor, state.limits.load);
}

/// Resets contact and energy accounts. Called in each tick in which the state is not `running`.
void reset_contact(ForceLaw& law, LoopState& state) noexcept {
  const double released_max_J = state.passivity.released_max_J;
  state.passivity = {};
  state.passivity.released_max_J = released_max_J;
  state.energy.reset();
  law.reset_motion();
  state.limits.rise_s = state.limits.overload_s = 0;
  state.compensation_Nm.setZero();
  state.compensation_authority = 0;
}

/// The device state read in a tick, and the fault found.
struct TickReading {
  DeviceState read;
  bool is_fresh = false;  ///< `read` is a new state of the device
  bool is_known = false;  ///< a device state has been read in this tick or earlier
  FaultDetail fault;
};

/// Stage 1: reads and checks the device. After the end of data the result is incomplete.
TickReading read_and_check(const LoopModel& model, const TickInputs& inputs, Device& device,
                           LoopState& state, TickResult& result) noexcept {
  TickReading out;
  out.fault = read_device(model, device, state, result, out.read, out.is_fresh);
  if (result.end_of_data) return out;
  const FaultDetail outside = outside_fault(model.limits, inputs);
  result.row.outside_fault = outside.fault;
  if (out.fault == Fault::kNone) out.fault = outside;
  result.row.recovery_asked = inputs.recover ? 1 : 0;
  if (inputs.recover) recover(state.safety, model.limits.timing, model.rate_Hz);
  out.is_known = state.has_state || out.is_fresh;
  if (out.fault == Fault::kNone && out.is_known)
    out.fault = check_health(model, out.read, out.is_fresh, state, result);
  state.previous = {};
  if (out.fault != Fault::kNone) {
    state.limits.has_pose = false;
    state.window.clear();
  } else if (out.is_fresh) {
    state.window.add(out.read, state.T_device_plate);
    state.previous = state.window.begin(encoder_count_rad(model.device), 1 / model.rate_Hz);
  }
  const bool is_finite = std::all_of(out.read.encoder_rad.begin(), out.read.encoder_rad.end(),
                                     [](double angle) { return std::isfinite(angle); });
  if (out.is_fresh && is_finite) {
    state.device = out.read;
    state.has_state = true;
  }
  if (out.is_fresh) state.no_data_ticks = 0;
  return out;
}

/// Stage 2: checks the motors' heat and advances the safety state.
void advance_safety(const LoopModel& model, const MotorModel& motor, const TickInputs& inputs,
                    const ForceLaw& law, Device& device, LoopState& state, TickReading& reading,
                    TickResult& result) noexcept {
  Safety& safety = state.safety;
  FaultDetail& fault = reading.fault;
  const double dt_s = 1 / model.rate_Hz;
  // The motors held their torques for the time on the device's clock, and at least for a tick.
  const double late_s = state.ahead_s > dt_s / 2 ? std::exchange(state.ahead_s, 0) : 0;
  const FaultDetail heat = check_heat(motor, state.tau_motor_Nm, dt_s + late_s, state.limits);
  if (fault == Fault::kNone) fault = heat;
  if (fault == Fault::kNone && safety.state == SafetyState::kRecovering &&
      safety.fault == Fault::kMotorOverload) {
    fault = check_motor_heat(motor, state.limits.load, kMaxHeatToRecover);
  }
  if (fault == Fault::kNone && reading.is_known)
    result.retract_distance_m = law.retract_distance_m(inputs.sheets, state.T_device_plate);
  const bool is_free =
      fault == Fault::kNone && reading.is_known && !(result.retract_distance_m > 0);
  advance(safety, model.limits.timing, model.rate_Hz, fault, result.row.t_s, reading.is_known,
          is_free);
  const DeviceStatus status = result.row.device_read;
  const bool is_away = status == DeviceStatus::kLinkLost || status == DeviceStatus::kMotorFault;
  if (safety.state == SafetyState::kRecovering && is_away) device.restore();
}

/// Stage 4: writes the torques.
void write_torques(const MotorVector& tau_motor_Nm, Device& device, LoopState& state,
                   FaultDetail& fault, RecordingRow& row) noexcept {
  DeviceCommand command;
  std::copy(tau_motor_Nm.data(), tau_motor_Nm.data() + kMotors, command.tau_motor_Nm.begin());
  DeviceStatus written = device.write(command);
  // Only read() may return kEndOfData.
  if (written == DeviceStatus::kEndOfData) written = DeviceStatus::kLinkLost;
  row.device_write = written;
  if (written != DeviceStatus::kOk) {
    // The device may or may not have applied these torques; the ramp starts from them.
    const bool was_running = state.safety.state == SafetyState::kRunning;
    const FaultDetail unwritten = written == DeviceStatus::kNoData
                                      ? FaultDetail(Fault::kWriteFailed)
                                      : fault_of(written, device);
    raise(state.safety, unwritten, row.t_s);
    if (fault == Fault::kNone) fault = unwritten;
    if (was_running) state.tau_at_stop_Nm = tau_motor_Nm;
  }
  state.tau_motor_Nm = tau_motor_Nm;
  note_delivered(rendered_wrench(state), state.passivity);
  state.energy.note_delivered(rendered_wrench(state));
}

}  // namespace

void haptic_tick(const LoopModel& model, const TickInputs& inputs, Device& device, ForceLaw& law,
                 LoopState& state, TickResult& result) noexcept {
  result = TickResult{};
  RecordingRow& row = result.row;
  Safety& safety = state.safety;
  const SafetyTiming& timing = model.limits.timing;
  const MotorModel motor = make_motor_model(model.device);
  row.t_s = static_cast<double>(state.tick) / model.rate_Hz;
  row.response_sheet = inputs.prefetched.sheet;
  row.response_stiffness_N_per_m = inputs.prefetched.stiffness_N_per_m;
  row.response_offset_m = inputs.prefetched.offset_m;

  TickReading reading = read_and_check(model, inputs, device, state, result);
  if (result.end_of_data) return;
  const SafetyState before = safety.state;
  advance_safety(model, motor, inputs, law, device, state, reading, result);

  // Stage 3: compute the torques.
  MotorVector tau_motor_Nm = MotorVector::Zero();
  if (safety.state == SafetyState::kRunning) {
    reading.fault = compute_torques(model, motor, inputs, law, state, result, tau_motor_Nm);
    if (reading.fault != Fault::kNone) raise(safety, reading.fault, row.t_s);
  }
  if (safety.state != SafetyState::kRunning) {
    if (before == SafetyState::kRunning) state.tau_at_stop_Nm = state.tau_motor_Nm;
    tau_motor_Nm = ramp_factor(safety, timing, model.rate_Hz) * state.tau_at_stop_Nm;
    reset_contact(law, state);
  }

  write_torques(tau_motor_Nm, device, state, reading.fault, row);
  const bool is_stopped =
      safety.state == SafetyState::kFault || safety.state == SafetyState::kRecovering;
  const bool was_stopped = before == SafetyState::kFault || before == SafetyState::kRecovering;
  if (is_stopped && !was_stopped) result.new_fault = safety.fault;
  result.found = reading.fault;
  result.at_rest = at_rest(safety, timing, model.rate_Hz);
  describe(model, motor, state, reading.read, row);
  law.finish_tick(row);
  ++state.tick;
}

}  // namespace trocar::runtime
