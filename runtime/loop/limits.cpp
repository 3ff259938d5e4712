// SPDX-License-Identifier: Apache-2.0
#include "runtime/loop/limits.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace trocar::runtime {

// Comparisons are written so that nan is beyond the limit.

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
  return upright >= std::cos(limits.plate_tilt_max_rad) ? Fault::kNone : Fault::kWorkspace;
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
  const bool good = state.twist_device.head<3>().norm() <= limits.speed_max_m_per_s &&
                    state.twist_device.tail<3>().norm() <= limits.turn_rate_max_rad_per_s;
  if (!state.twist_device.allFinite()) state.has_pose = false;
  return good ? Fault::kNone : Fault::kSpeed;
}

Fault check_heat(const SafetyLimits& limits, const DeviceDescription& device,
                 const MotorVector& tau_motor_Nm, double dt_s, LimitState& state) noexcept {
  const double share = limits.thermal_s > 0 ? 1 - std::exp(-dt_s / limits.thermal_s) : 1;
  const MotorVector now = (tau_motor_Nm / device.motor_continuous_torque_Nm).cwiseAbs2();
  state.heat += share * (now - state.heat);
  return state.heat.maxCoeff() <= 1 + 1e-9 ? Fault::kNone : Fault::kMotorOverload;
}

MotorVector limit_rise(const MotorVector& last, const MotorVector& wanted, double rise_max_Nm,
                       bool& shortened) noexcept {
  shortened = false;
  const double step_Nm = (wanted - last).cwiseAbs().maxCoeff();
  const bool grows = wanted.cwiseAbs().maxCoeff() > last.cwiseAbs().maxCoeff();
  if (!grows || step_Nm <= rise_max_Nm) return wanted;
  shortened = true;
  return last + (rise_max_Nm / step_Nm) * (wanted - last);
}

Fault limit_torques(const SafetyLimits& limits, const DeviceDescription& device,
                    const MotorVector& last_Nm, double dt_s, MotorVector& wanted_Nm,
                    LimitState& state) noexcept {
  if (!wanted_Nm.allFinite()) return Fault::kTorqueNotFinite;
  const double peak_Nm = device.motor_peak_torque_Nm;
  const double largest_Nm = limits.torque_max_Nm > 0 ? limits.torque_max_Nm : peak_Nm * (1 + 1e-9);
  if (wanted_Nm.cwiseAbs().maxCoeff() > largest_Nm) return Fault::kTorqueLimit;
  const double rise_max_Nm = limits.torque_rise_max_Nm_per_s * dt_s;
  bool shortened = false;
  const MotorVector tau_Nm = limit_rise(last_Nm, wanted_Nm, rise_max_Nm, shortened);
  if (!tau_Nm.allFinite()) return Fault::kTorqueNotFinite;
  if (shortened) {
    state.rise_s += dt_s;
  } else if ((wanted_Nm - last_Nm).cwiseAbs().maxCoeff() <= rise_max_Nm / 2) {
    state.rise_s = 0;  // a steep release is no pause
  }
  // Between two torques within the limit only rounding can leave it.
  wanted_Nm = tau_Nm.cwiseMax(-peak_Nm).cwiseMin(peak_Nm);
  return state.rise_s > limits.torque_rise_time_max_s + dt_s / 2 ? Fault::kTorqueRate
                                                                 : Fault::kNone;
}

}  // namespace trocar::runtime
