// SPDX-License-Identifier: Apache-2.0
#include "runtime/haptics/loop/safety.h"

namespace trocar::runtime {

namespace {

/// Returns the tilt of an axis whose upright component is `cosine`; nan if that is nan.
double tilt_rad(double cosine) noexcept {
  return std::acos(std::clamp(cosine, -1.0, 1.0));
}

using enum SafetyState;

// Rows: states; columns: kSeen, kFree, kFault, kRecover, kSettled, kStop.
constexpr std::array<std::array<SafetyState, kSafetyEvents>, kSafetyStates> kNext = {{
    {kReady, kIdle, SafetyState::kFault, kIdle, kIdle, SafetyState::kFault},
    {kReady, kRunning, SafetyState::kFault, kReady, kReady, SafetyState::kFault},
    {kRunning, kRunning, SafetyState::kFault, kRunning, kRunning, SafetyState::kFault},
    {SafetyState::kFault, SafetyState::kFault, SafetyState::kFault, kRecovering,
     SafetyState::kFault, SafetyState::kFault},
    {kRecovering, kRecovering, kRecovering, kRecovering, kReady, SafetyState::kFault},
}};

constexpr std::uint64_t kNoRamp = 1'000'000;  // ramp_ticks_done that is larger than any ramp

void latch(Safety& safety, Fault fault, double t_s) noexcept {
  ++safety.faults;
  safety.waits_for_ramp = false;
  safety.fault = fault;
  safety.fault_t_s = t_s;
  if (safety.state == kRunning) safety.ramp_ticks_done = fault == Fault::kEnergyLimit ? kNoRamp : 0;
}

void stop(Safety& safety, Fault fault, double t_s) noexcept {
  latch(safety, fault, t_s);
  safety.quiet_ticks = 0;
  safety.state = next_state(safety.state, SafetyEvent::kStop);
}

}  // namespace

// Comparisons are negated so that a value of nan is beyond the limit, and a limit of
// nan always trips.

FaultDetail check_workspace(const SafetyLimits& limits, const Pose& T_device_plate) noexcept {
  for (int i = 0; i < 3; ++i) {
    const double at_m = T_device_plate.p_m[i];
    const auto k = static_cast<std::size_t>(i);
    const bool above = at_m >= limits.workspace_min_m[k];
    if (!(above && at_m <= limits.workspace_max_m[k])) {
      return {Fault::kWorkspace, FaultQuantity::kPlatePosition, i, at_m,
              above ? limits.workspace_max_m[k] : limits.workspace_min_m[k]};
    }
  }
  const double upright = (T_device_plate.q * Eigen::Vector3d::UnitZ()).z();
  const bool good =
      limits.plate_tilt_max_rad >= std::numbers::pi  // no tilt is larger
          ? std::isfinite(upright)
          // A negative limit must be tested separately, because the cosine loses its sign.
          : limits.plate_tilt_max_rad >= 0 && upright >= std::cos(limits.plate_tilt_max_rad);
  if (good) return {};
  return {Fault::kWorkspace, FaultQuantity::kPlateTilt, -1, tilt_rad(upright),
          limits.plate_tilt_max_rad};
}

FaultDetail check_speed(const SafetyLimits& limits, const Pose& T_device_plate, double dt_s,
                        SpeedState& state) noexcept {
  Twist now = Twist::Zero();
  if (state.has_pose) {
    now << (T_device_plate.p_m - state.T_device_plate.p_m) / dt_s,
        rotation_vector(T_device_plate.q * state.T_device_plate.q.conjugate()) / dt_s;
  } else {
    state.twist_device.setZero();
  }
  state.has_pose = true;
  state.T_device_plate = T_device_plate;
  state.twist_device += dt_s / (limits.speed_window_s + dt_s) * (now - state.twist_device);
  const double speed_m_per_s = state.twist_device.head<3>().norm();
  const double rotation_rad_per_s = state.twist_device.tail<3>().norm();
  if (!state.twist_device.allFinite()) state.has_pose = false;
  if (!(limits.speed_window_s >= 0 && speed_m_per_s <= limits.speed_max_m_per_s))
    return {Fault::kSpeed, FaultQuantity::kPlateSpeed, -1, speed_m_per_s, limits.speed_max_m_per_s};
  if (!(rotation_rad_per_s <= limits.rotation_rate_max_rad_per_s)) {
    return {Fault::kSpeed, FaultQuantity::kPlateRotation, -1, rotation_rad_per_s,
            limits.rotation_rate_max_rad_per_s};
  }
  return {};
}

SafetyState next_state(SafetyState state, SafetyEvent event) noexcept {
  return kNext[static_cast<std::size_t>(state)][static_cast<std::size_t>(event)];
}

int ramp_ticks(const SafetyTiming& timing, double rate_Hz) noexcept {
  // Written so that nan counts as zero.
  const double ramp_s = timing.ramp_s > 0 ? std::min(timing.ramp_s, kRampMax_s) : 0;
  return std::max(1, static_cast<int>(std::floor(ramp_s * rate_Hz + 1e-9)));
}

double rise_per_tick(const SafetyTiming& timing, double rate_Hz) noexcept {
  if (timing.ramp_up_s <= 0) return 1;
  return std::isnan(timing.ramp_up_s) ? 0 : 1 / (timing.ramp_up_s * rate_Hz);
}

bool raise(Safety& safety, Fault fault, double t_s) noexcept {
  const bool latches = safety.state != SafetyState::kFault && safety.state != kRecovering;
  if (latches) latch(safety, fault, t_s);
  safety.quiet_ticks = 0;
  safety.state = next_state(safety.state, SafetyEvent::kFault);
  return latches;
}

void take_stops(Safety& safety, DeviceStatus read, Fault outside, double t_s) noexcept {
  if (safety.stops.take(read, outside))
    stop(safety, Fault::kEmergencyStop, t_s);
  else if (safety.state == kRecovering && is_stop(outside))
    stop(safety, outside, t_s);
}

void take_written(Safety& safety, DeviceStatus written, double t_s) noexcept {
  if (safety.stops.take_write(written)) stop(safety, Fault::kEmergencyStop, t_s);
}

RecoveryAnswer answer_request(Safety& safety, RecoveryRequest request, const SafetyTiming& timing,
                              double rate_Hz) noexcept {
  const bool is_refused = safety.stops.refuse_recovery();
  const bool is_wanted = request == RecoveryRequest::kByOperator ||
                         (request == RecoveryRequest::kAutomatic && !is_refused &&
                          !is_stop(safety.fault) && torques_are_zero(safety, timing, rate_Hz));
  if (is_refused) {
    safety.waits_for_ramp = false;
    return is_wanted ? RecoveryAnswer::kRefused : RecoveryAnswer::kNone;
  }
  safety.waits_for_ramp |= is_wanted && safety.state == SafetyState::kFault;
  if (safety.waits_for_ramp && torques_are_zero(safety, timing, rate_Hz)) {
    safety.waits_for_ramp = false;
    safety.quiet_ticks = 0;
    safety.state = next_state(safety.state, SafetyEvent::kRecover);
  }
  return is_wanted ? RecoveryAnswer::kTaken : RecoveryAnswer::kNone;
}

void advance(Safety& safety, const SafetyTiming& timing, double rate_Hz, Fault fault, double t_s,
             bool seen, bool free) noexcept {
  if (fault != Fault::kNone) {
    raise(safety, fault, t_s);
    return;
  }
  switch (safety.state) {
    case kIdle:
      if (seen) safety.state = next_state(safety.state, SafetyEvent::kSeen);
      break;
    case kReady:
      if (!free) break;
      safety.state = next_state(safety.state, SafetyEvent::kFree);
      safety.authority = safety.recovered ? 0 : 1;
      break;
    case kRunning:
      safety.authority = std::min(1.0, safety.authority + rise_per_tick(timing, rate_Hz));
      break;
    case SafetyState::kFault:
      break;
    case kRecovering:
      safety.quiet_ticks = free ? safety.quiet_ticks + 1 : 0;
      if (!(static_cast<double>(safety.quiet_ticks) >= timing.quiet_s * rate_Hz)) break;
      safety.state = next_state(safety.state, SafetyEvent::kSettled);
      safety.fault = Fault::kNone;
      safety.recovered = true;
      break;
  }
}

double ramp_factor(Safety& safety, const SafetyTiming& timing, double rate_Hz) noexcept {
  const int ticks = ramp_ticks(timing, rate_Hz);
  ++safety.ramp_ticks_done;
  return std::max(0.0, 1 - static_cast<double>(safety.ramp_ticks_done) / ticks);
}

bool torques_are_zero(const Safety& safety, const SafetyTiming& timing, double rate_Hz) noexcept {
  return safety.state == SafetyState::kFault &&
         safety.ramp_ticks_done >= static_cast<std::uint64_t>(ramp_ticks(timing, rate_Hz));
}

}  // namespace trocar::runtime
