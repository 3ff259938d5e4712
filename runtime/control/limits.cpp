// SPDX-License-Identifier: Apache-2.0
#include "runtime/control/limits.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace trocar::runtime {

// Comparisons are negated so that a value of nan is beyond the limit, and a limit of nan always
// trips.

Fault check_workspace(const SafetyLimits& limits, const Pose& T_device_plate) noexcept {
  for (int i = 0; i < 3; ++i) {
    const double at_m = T_device_plate.p_m[i];
    const auto k = static_cast<std::size_t>(i);
    if (!(at_m >= limits.workspace_min_m[k] && at_m <= limits.workspace_max_m[k])) {
      return Fault::kWorkspace;
    }
  }
  const double upright = (T_device_plate.q * Eigen::Vector3d::UnitZ()).z();
  if (limits.plate_tilt_max_rad >= std::numbers::pi)  // no tilt is larger
    return std::isfinite(upright) ? Fault::kNone : Fault::kWorkspace;
  const bool good =  // a negative limit always trips: the cosine would lose its sign
      limits.plate_tilt_max_rad >= 0 && upright >= std::cos(limits.plate_tilt_max_rad);
  return good ? Fault::kNone : Fault::kWorkspace;
}

Fault check_speed(const SafetyLimits& limits, const Pose& T_device_plate, double dt_s,
                  LimitState& state) noexcept {
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
  const bool good = limits.speed_window_s >= 0 &&
                    state.twist_device.head<3>().norm() <= limits.speed_max_m_per_s &&
                    state.twist_device.tail<3>().norm() <= limits.rotation_rate_max_rad_per_s;
  if (!state.twist_device.allFinite()) state.has_pose = false;
  return good ? Fault::kNone : Fault::kSpeed;
}

Fault check_singularity(const SafetyLimits& limits, const Singularity& singularity) noexcept {
  return singularity.inverse_condition >= limits.inverse_condition_min &&
                 singularity.nearest_branch_m >= limits.branch_distance_min_m
             ? Fault::kNone
             : Fault::kSingularity;
}

Fault check_heat(const MotorModel& motor, const MotorVector& tau_motor_Nm, double dt_s,
                 LimitState& state) noexcept {
  state.load = advance(motor, state.load, motor_currents(motor, tau_motor_Nm), dt_s);
  return i2t_share_used(motor, state.load) <= 1 + 1e-9 ? Fault::kNone : Fault::kMotorOverload;
}

Fault check_overload(const SafetyLimits& limits, const MotorModel& motor, double scale, double dt_s,
                     LimitState& state) noexcept {
  const bool derated = (available_torque(motor, state.load).array() < motor.peak_Nm.array()).any();
  const bool too_little = derated && !(scale >= limits.overload_scale_min);
  state.overload_s = too_little ? state.overload_s + dt_s : 0;
  return state.overload_s <= limits.overload_time_max_s + dt_s / 2 ? Fault::kNone
                                                                   : Fault::kMotorOverload;
}

MotorVector limit_rise(const MotorVector& last, const MotorVector& wanted, double rise_max_Nm,
                       bool& shortened) noexcept {
  shortened = false;
  const bool grows = wanted.cwiseAbs().maxCoeff() > last.cwiseAbs().maxCoeff();
  double share = 1;
  for (int i = 0; i < kMotors; ++i) {
    const double step_Nm = std::abs(wanted[i] - last[i]);
    const bool falls = !grows && last[i] * (wanted[i] - last[i]) < 0;
    const bool reverses = falls && last[i] * wanted[i] < 0;
    const double rise_Nm = reverses ? std::abs(wanted[i]) : falls ? 0 : step_Nm;
    const double free_Nm = reverses ? std::abs(last[i]) : 0;
    if (rise_Nm > rise_max_Nm) share = std::min(share, (free_Nm + rise_max_Nm) / step_Nm);
  }
  if (share == 1) return wanted;
  shortened = true;
  return last + share * (wanted - last);
}

Fault limit_torques(const SafetyLimits& limits, const MotorVector& limit_Nm,
                    const MotorVector& last_Nm, double dt_s, MotorVector& wanted_Nm,
                    LimitState& state) noexcept {
  if (!wanted_Nm.allFinite()) return Fault::kTorqueNotFinite;
  const MotorVector largest_Nm = limits.torque_max_Nm == 0
                                     ? MotorVector(limit_Nm * (1 + 1e-9))
                                     : MotorVector::Constant(limits.torque_max_Nm);
  if (!(wanted_Nm.cwiseAbs().array() <= largest_Nm.array()).all()) return Fault::kTorqueLimit;
  const double rise_max_Nm = limits.torque_rise_max_Nm_per_s * dt_s;
  if (!(rise_max_Nm >= 0)) return Fault::kTorqueRate;
  bool shortened = false;
  MotorVector tau_Nm = limit_rise(last_Nm, wanted_Nm, rise_max_Nm, shortened);
  if (!tau_Nm.allFinite()) return Fault::kTorqueNotFinite;
  if (shortened) {
    state.rise_s += dt_s;
  } else if ((wanted_Nm - last_Nm).cwiseAbs().maxCoeff() <= rise_max_Nm / 2) {
    state.rise_s = 0;  // a steep release does not reset it
  }
  const double beyond = tau_Nm.cwiseQuotient(limit_Nm).cwiseAbs().maxCoeff();
  if (beyond > 1) tau_Nm /= beyond;
  wanted_Nm = tau_Nm.cwiseMax(-limit_Nm).cwiseMin(limit_Nm);  // rounding
  return state.rise_s <= limits.torque_rise_time_max_s + dt_s / 2 ? Fault::kNone
                                                                  : Fault::kTorqueRate;
}

}  // namespace trocar::runtime
