// SPDX-License-Identifier: Apache-2.0
#include "runtime/haptics/loop/haptic_loop.h"

#include "runtime/realtime/realtime_thread.h"

namespace trocar::runtime {
namespace {

/// Sets pose_interval_s (contract 4). Returns false if the device state is not new. `leap`: before,
/// true in the replay of a tick in which the device's clock leapt; afterwards, true if this
/// computer's clock is needed to know that.
bool take_time(const LoopModel& model, double t_s, LoopState& state, FaultDetail& fault,
               bool& leap) noexcept {
  const bool is_replayed_leap = std::exchange(leap, false);
  if (!std::isfinite(t_s)) return false;
  const SafetyLimits& limits = model.limits;
  // Both time stamps are whole nanoseconds (device_link.md).
  const double since_s = state.has_reading ? std::round((t_s - state.reading_t_s) * 1e9) / 1e9 : 0;
  // The motion since the last new state shows with the next one.
  if (since_s > 0 && since_s < kLeastInterval / model.rate_Hz) return false;
  // If ticks may be late, a late tick explains as much.
  const bool may_be_late = limits.gap_max_s == 0;
  const double most_s = limits.state_gap_max_s + (may_be_late ? state.host_s : 0);
  const bool too_long = is_replayed_leap || !(since_s <= most_s);
  if (since_s > 0 && !too_long) {
    const double ticks_s = (1 + state.no_data_ticks) / model.rate_Hz;
    state.pose_interval_s = since_s;
    state.ahead_s = std::max(-limits.no_data_max_s, state.ahead_s + since_s - ticks_s);
    return true;
  }
  if (state.safety.state == SafetyState::kRunning) {
    if (since_s > 0) {
      fault = {Fault::kNoData, FaultQuantity::kTimeWithoutData, -1, since_s, most_s};
      leap = may_be_late;
    }
    return since_s > 0;
  }
  // The hand may have moved anywhere meanwhile, so the kept reading shows no jump.
  state.has_reading = false;
  state.speed.has_pose = false;
  state.estimate.reset();
  state.ahead_s = 0;
  return true;
}

/// Reads the device. If there is no new reading, the last one is used, and `fresh` is false.
FaultDetail read_device(const LoopModel& model, HandDevice& device, LoopState& state,
                        TickResult& result, double& t_s, bool& fresh, bool& leap) noexcept {
  FaultDetail fault;
  state.pose_interval_s = 0;
  DeviceStatus status = device.read(t_s);
  result.end_of_data = status == DeviceStatus::kEndOfData;
  if (status == DeviceStatus::kOk && !take_time(model, t_s, state, fault, leap))
    status = DeviceStatus::kNoData;
  if (!result.end_of_data) result.row.device_read = status;
  fresh = status == DeviceStatus::kOk;
  if (fresh || result.end_of_data) return fault;
  device.use_last_reading();
  ++state.no_data_ticks;
  if (status != DeviceStatus::kNoData) return device.fault_of(status);
  const double limit_s = no_data_limit_s(model.limits.no_data_max_s, model.rate_Hz);
  // Half a tick allows for rounding, so that 10 ms are ten ticks at 1 kHz.
  const double no_data_s = static_cast<double>(state.no_data_ticks) / model.rate_Hz;
  if (no_data_s < limit_s - 0.5 / model.rate_Hz) return {};
  const FaultDetail refused = device.refused_contents();
  if (refused != Fault::kNone) return refused;
  return {Fault::kNoData, FaultQuantity::kTimeWithoutData, -1, no_data_s, limit_s};
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

/// Returns the time in which the device may have moved since the last reading: the time on the
/// device's clock, but at most the time of the counted ticks or no_data_max_s, whichever is longer.
ReadingInterval reading_interval(const LoopModel& model, const LoopState& state) noexcept {
  const double ticks_s = (1 + state.no_data_ticks) / model.rate_Hz;
  const double step_s =
      state.pose_interval_s > 0
          ? std::min(state.pose_interval_s, std::max(ticks_s, model.limits.no_data_max_s))
          : ticks_s;
  return {state.has_reading, step_s};
}

/// Contract 6.
double estimate_interval_s(const LoopModel& model, const LoopState& state) noexcept {
  constexpr double kOnTime = 0.01;
  const double ticks = state.pose_interval_s * model.rate_Hz;
  const bool is_on_time = !(ticks > 0) || std::abs(ticks - 1) < kOnTime;
  return is_on_time ? 1 / model.rate_Hz : state.pose_interval_s;
}

FaultDetail tool_tilt(const Tool& tool, const Pose& T_device_plate) noexcept {
  const double upright = (T_device_plate.q * tool.axis_plate).z();
  return {Fault::kToolTilt, FaultQuantity::kToolTilt, -1, std::acos(std::clamp(upright, -1.0, 1.0)),
          kMaxTilt_deg * std::numbers::pi / 180};
}

/// Runs all checks that need no wrench. They are the same in every safety state.
FaultDetail check_health(const LoopModel& model, HandDevice& device, bool fresh, LoopState& state,
                         TickResult& result) noexcept {
  PlatePose pose;
  if (const FaultDetail f = device.find_pose(reading_interval(model, state), pose);
      f != Fault::kNone) {
    return f;
  }
  state.T_device_plate = pose.T_device_plate;
  result.row.pose_residual_m = pose.residual_m;
  if (fresh) {
    const double interval_s =
        state.pose_interval_s > 0 ? state.pose_interval_s : 1 / model.rate_Hz;  // the first pose
    const FaultDetail speed =
        check_speed(model.limits, state.T_device_plate, interval_s, state.speed);
    if (speed != Fault::kNone) return speed;
  }
  if (const FaultDetail f = check_workspace(model.limits, state.T_device_plate);
      f != Fault::kNone) {
    return f;
  }
  if (const FaultDetail f = device.check_own_workspace(); f != Fault::kNone) return f;
  return is_upright(model.tool, state.T_device_plate) ? FaultDetail()
                                                      : tool_tilt(model.tool, state.T_device_plate);
}

void put_wrench(const Wrench& wrench, std::array<double, 6>& out) noexcept {
  std::copy(wrench.data(), wrench.data() + 6, out.begin());
}

/// Computes the wrench to render: the force law's wrench, multiplied by Safety::authority and by
/// the guard's factor, and the damping after a break.
FaultDetail wanted_wrench(const LoopModel& model, const TickInputs& inputs, double mass_kg,
                          ForceLaw& law, LoopState& state, TickResult& result,
                          Wrench& wanted) noexcept {
  ContactOutput& contact = result.contact;
  const double dt_s = 1 / model.rate_Hz;
  const Twist& twist = state.estimate.twist_device();
  const Pose led = state.estimate.ahead(model.estimator);
  const ForceLawInput input{.sheets = inputs.sheets,
                            .prefetched = inputs.prefetched,
                            .T_device_plate = led,
                            .pose_interval_s = state.estimate_interval_s,
                            .previous = {moved(led, -dt_s * twist), dt_s},
                            .twist_device = twist,
                            .T_device_measured = state.T_device_plate};
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

  double factor = state.safety.authority;
  if (model.guards) {
    const std::uint32_t acted = state.guard.acted;
    guard_contact({.interval_s = dt_s,
                   .twist_device = twist,
                   .wrench_device = contact.wrench_plate,
                   .band_m_per_s = model.band_m_per_s,
                   .band_rad_per_s = model.band_rad_per_s,
                   .way_m = model.way_m,
                   .way_rad = model.way_rad},
                  state.guard);
    result.guard_acted = state.guard.acted != acted;
    factor *= state.guard.factor;
  }
  wanted = factor * contact.wrench_plate;
  observe_passivity({.T_device_plate = state.T_device_plate,
                     .wrench_device = wanted,
                     .stored_J = factor * contact.stored_J,
                     .planned_release = contact.is_released},
                    state.passivity);
  if (!model.guards) return Fault::kNone;
  const Wrench damping = damp_break(
      mass_kg, model.tool, {state.T_device_plate, twist, dt_s, factor * contact.lost_force_N},
      state.break_damper);
  // Adding a zero could change the sign of a zero.
  if (state.break_damper.force_N > 0) wanted += damping;
  return Fault::kNone;
}

/// Computes the wrench of the contact, and lets the device prepare the command that renders it.
FaultDetail render(const LoopModel& model, const TickInputs& inputs, HandDevice& device,
                   ForceLaw& law, LoopState& state, TickResult& result) noexcept {
  RecordingRow& row = result.row;
  RenderInput input;
  const double mass_kg = device.specification().mass_kg();
  const FaultDetail found = wanted_wrench(model, inputs, mass_kg, law, state, result, input.wanted);
  if (found != Fault::kNone) return found;
  input.twist_device = state.speed.twist_device;
  input.dt_s = 1 / model.rate_Hz;
  input.compensation = model.compensation;
  input.authority_rise = rise_per_tick(model.limits.timing, model.rate_Hz);
  const FaultDetail refused = device.render(input, row.wrench_scale);
  if (refused != Fault::kNone) return refused;

  row.phase = result.contact.phase;
  row.active_slice = result.contact.active_sheet < 0
                         ? -1
                         : inputs.sheets[result.contact.active_sheet]->slice_index;
  row.penetration_m = result.contact.penetration_m;
  put_wrench(input.wanted, row.wrench_wanted);
  return Fault::kNone;
}

/// Fills the columns that do not depend on the tick's outcome.
void describe(const LoopModel& model, const HandDevice& device, const LoopState& state,
              TickResult& result) noexcept {
  RecordingRow& row = result.row;
  const Pose& pose = state.T_device_plate;
  const Eigen::Vector3d tip = pose * model.tool.tip_plate_m;
  row.p_m = {pose.p_m.x(), pose.p_m.y(), pose.p_m.z()};
  row.q = {pose.q.w(), pose.q.x(), pose.q.y(), pose.q.z()};
  row.tool_m = {tip.x(), tip.y(), tip.z()};
  device.describe(row, result.readout);
  put_wrench(device.delivered(), row.wrench_delivered);
  row.safety = state.safety.state;
  row.fault = state.safety.fault;
  const bool stopped = row.safety == SafetyState::kFault || row.safety == SafetyState::kRecovering;
  if (stopped) row.phase = ContactPhase::kFault;
  const bool is_running = row.safety == SafetyState::kRunning;
  row.authority = is_running ? state.safety.authority : 0;
  row.tip_N = is_running ? result.contact.force_N : 0;
  row.passivity_J = state.passivity.balance_J;
  row.guard = state.guard.factor;
}

/// Resets contact and energy accounts. Called in each tick in which the state is not `running`.
void reset_contact(ForceLaw& law, LoopState& state) noexcept {
  const double released_max_J = state.passivity.released_max_J;
  state.passivity = {};
  state.passivity.released_max_J = released_max_J;
  state.break_damper = {};
  state.guard = {};
  state.energy.reset();
  law.reset_motion();
}

/// The reading of a tick, and the fault found.
struct TickReading {
  bool is_fresh = false;  ///< the device has a new reading
  bool is_known = false;  ///< there was a reading in this tick or earlier
  FaultDetail fault;
};

/// Stage 1: reads and checks the device. After the end of data the result is incomplete.
TickReading read_and_check(const LoopModel& model, const TickInputs& inputs, HandDevice& device,
                           LoopState& state, TickResult& result) noexcept {
  TickReading out;
  double t_s = state.reading_t_s;
  bool leap = inputs.outside == Fault::kNoData;  // no live caller finds this fault
  state.host_s += inputs.gap_s;
  out.fault = read_device(model, device, state, result, t_s, out.is_fresh, leap);
  if (result.end_of_data) return out;
  if (out.is_fresh) state.host_s = 0;
  const FaultDetail outside = outside_fault(model.limits, inputs);
  result.row.outside_fault = outside.fault;
  // A replay does not know this computer's clock.
  if (leap && outside == Fault::kNone) result.row.outside_fault = Fault::kNoData;
  if (out.fault == Fault::kNone || outside == Fault::kEmergencyStop) out.fault = outside;
  take_stops(state.safety, result.row.device_read, outside.fault, result.row.t_s);
  const RecoveryAnswer answer =
      answer_request(state.safety, inputs.recover, model.limits.timing, model.rate_Hz);
  result.row.recovery_asked = answer == RecoveryAnswer::kNone ? 0 : 1;
  result.recovery_is_refused = answer == RecoveryAnswer::kRefused;
  out.is_known = state.has_reading || out.is_fresh;
  if (out.fault == Fault::kNone && out.is_known)
    out.fault = check_health(model, device, out.is_fresh, state, result);
  state.estimate_interval_s = 0;
  if (out.fault != Fault::kNone) {
    state.speed.has_pose = false;
    state.estimate.reset();
  } else if (out.is_fresh) {
    const double interval_s = estimate_interval_s(model, state);
    state.estimate.follow(model.estimator, state.T_device_plate, interval_s, 1 / model.rate_Hz);
    if (state.pose_interval_s > 0) state.estimate_interval_s = interval_s;
  }
  if (out.is_fresh && device.keep_reading()) {
    state.reading_t_s = t_s;
    state.has_reading = true;
  }
  if (out.is_fresh) state.no_data_ticks = 0;
  return out;
}

/// Stage 2: checks what the last command did to the device, and advances the safety state.
void advance_safety(const LoopModel& model, const TickInputs& inputs, const ForceLaw& law,
                    HandDevice& device, LoopState& state, TickReading& reading,
                    TickResult& result) noexcept {
  Safety& safety = state.safety;
  FaultDetail& fault = reading.fault;
  const double dt_s = 1 / model.rate_Hz;
  // The device held its command for the time on the device's clock, and at least for a tick.
  const double late_s = state.ahead_s > dt_s / 2 ? std::exchange(state.ahead_s, 0) : 0;
  const FaultDetail heat = device.account_held_time(dt_s + late_s);
  if (fault == Fault::kNone) fault = heat;
  if (fault == Fault::kNone && safety.state == SafetyState::kRecovering && state.must_rest)
    fault = device.check_rested();
  if (fault == Fault::kNone && reading.is_known)
    result.retract_distance_m = law.retract_distance_m(inputs.sheets, state.T_device_plate);
  const bool is_free =
      fault == Fault::kNone && reading.is_known && !(result.retract_distance_m > 0);
  advance(safety, model.limits.timing, model.rate_Hz, fault, result.row.t_s, reading.is_known,
          is_free);
  const DeviceStatus status = result.row.device_read;
  const bool is_away = status == DeviceStatus::kLinkLost || status == DeviceStatus::kMotorFault;
  // A refused request also restores a link, because the release of a stop comes by the link.
  const bool is_asked = safety.state == SafetyState::kRecovering || result.recovery_is_refused;
  if (is_asked && is_away) device.restore();
}

/// Stage 4: sends the command.
void write_command(HandDevice& device, LoopState& state, FaultDetail& fault,
                   RecordingRow& row) noexcept {
  DeviceStatus written = device.write();
  // Only read() may return kEndOfData.
  if (written == DeviceStatus::kEndOfData) written = DeviceStatus::kLinkLost;
  row.device_write = written;
  const bool was_running = state.safety.state == SafetyState::kRunning;
  take_written(state.safety, written, row.t_s);
  if (written != DeviceStatus::kOk) {
    // The device may or may not have applied this command; the ramp starts from it.
    const FaultDetail unwritten = written == DeviceStatus::kNoData
                                      ? FaultDetail(Fault::kWriteFailed)
                                      : device.fault_of(written);
    raise(state.safety, unwritten, row.t_s);
    if (fault == Fault::kNone) fault = unwritten;
    if (was_running) device.stop();
  }
  const Wrench delivered = device.delivered();
  state.passivity.delivered = delivered;
  state.energy.note_delivered(delivered);
}

/// Looks for a break-through. Call this when the row is complete but for these columns.
void note_break_through(const LoopModel& model, std::span<const Sheet* const> sheets,
                        LoopState& state, TickResult& result) noexcept {
  RecordingRow& row = result.row;
  if (row.safety != SafetyState::kRunning) {
    state.break_through = {};
    return;
  }
  const Pose& plate = state.T_device_plate;
  result.break_through = find_break_through(
      {1 / model.rate_Hz, Eigen::Vector3d(row.tool_m.data()), plate * model.tool.tip_plate_m,
       -(plate.q * model.tool.axis_plate), result.contact},
      state.break_through);
  if (const auto& found = result.break_through.found) {
    row.break_through_N = found->reference_N;
    if (found->layer >= 0) row.break_through_at = kBreakThroughLayer - found->layer;
    if (found->sheet >= 0)
      row.break_through_at = sheets[static_cast<std::size_t>(found->sheet)]->slice_index;
  }
}

}  // namespace

void haptic_tick(const LoopModel& model, const TickInputs& inputs, HandDevice& device,
                 ForceLaw& law, LoopState& state, TickResult& result) noexcept {
  result = TickResult{};
  RecordingRow& row = result.row;
  Safety& safety = state.safety;
  const SafetyTiming& timing = model.limits.timing;
  const std::int64_t begin_ns = monotonic_ns();
  row.t_s = static_cast<double>(state.tick) / model.rate_Hz;
  row.response_sheet = inputs.prefetched.sheet;
  row.response_stiffness_N_per_m = inputs.prefetched.stiffness_N_per_m;
  row.response_offset_m = inputs.prefetched.offset_m;

  const SafetyState before = safety.state;
  const std::uint64_t faults_before = safety.faults;
  TickReading reading = read_and_check(model, inputs, device, state, result);
  if (result.end_of_data) return;
  const std::int64_t read_ns = monotonic_ns();
  advance_safety(model, inputs, law, device, state, reading, result);
  const bool has_run = before == SafetyState::kRunning || safety.state == SafetyState::kRunning;

  // Stage 3: prepare the command.
  if (safety.state == SafetyState::kRunning) {
    reading.fault = render(model, inputs, device, law, state, result);
    if (reading.fault != Fault::kNone) raise(safety, reading.fault, row.t_s);
  }
  if (safety.state != SafetyState::kRunning) {
    // A fault in the first tick of `running` also begins a ramp, from the zero torques before it.
    if (has_run) device.stop();
    device.fade(ramp_factor(safety, timing, model.rate_Hz));
    reset_contact(law, state);
  }

  const std::int64_t prepared_ns = monotonic_ns();
  write_command(device, state, reading.fault, row);
  result.law_ns = prepared_ns - read_ns;
  result.device_ns = read_ns - begin_ns + (monotonic_ns() - prepared_ns);
  if (safety.faults != faults_before) result.new_fault = safety.fault;
  if (safety.state == SafetyState::kRunning) state.must_rest = false;
  if (result.new_fault == Fault::kMotorOverload) state.must_rest = true;
  result.found = reading.fault;
  // A stop is latched even if the tick found something else first.
  if (result.new_fault != Fault::kNone && result.found != result.new_fault)
    result.found = result.new_fault;
  result.torques_are_zero = torques_are_zero(safety, timing, model.rate_Hz);
  describe(model, device, state, result);
  law.finish_tick(row);
  note_break_through(model, inputs.sheets, state, result);
  ++state.tick;
}

}  // namespace trocar::runtime
