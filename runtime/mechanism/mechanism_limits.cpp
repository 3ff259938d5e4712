// SPDX-License-Identifier: Apache-2.0
#include "runtime/mechanism/mechanism_limits.h"

#include <algorithm>
#include <cmath>

namespace trocar::runtime {

// Comparisons are negated so that a value of nan is beyond the limit, and a limit of
// nan always trips.

FaultDetail check_singularity(const MechanismLimits& limits,
                              const Singularity& singularity) noexcept {
  if (!(singularity.inverse_condition >= limits.inverse_condition_min)) {
    return {Fault::kSingularity, FaultQuantity::kInverseCondition, -1,
            singularity.inverse_condition, limits.inverse_condition_min};
  }
  if (!(singularity.nearest_branch_m >= limits.branch_distance_min_m)) {
    return {Fault::kSingularity, FaultQuantity::kBranchDistance, singularity.nearest_leg - 1,
            singularity.nearest_branch_m, limits.branch_distance_min_m};
  }
  return {};
}

FaultDetail check_motor_heat(const MotorModel& motor, const MotorLoad& load,
                             double share_max) noexcept {
  int hottest = 0;
  const double share = i2t_fraction_used(motor, load, &hottest);
  if (share <= share_max) return {};
  return {Fault::kMotorOverload, FaultQuantity::kMotorHeat, hottest, share, share_max};
}

FaultDetail check_heat(const MotorModel& motor, const MotorVector& tau_motor_Nm, double dt_s,
                       MotorState& state) noexcept {
  state.load = advance(motor, state.load, motor_currents(motor, tau_motor_Nm), dt_s);
  return check_motor_heat(motor, state.load, 1 + 1e-9);
}

FaultDetail check_overload(const MechanismLimits& limits, const MotorModel& motor, double scale,
                           double dt_s, MotorState& state) noexcept {
  const bool derated = (available_torque(motor, state.load).array() < motor.peak_Nm.array()).any();
  const bool too_little = derated && !(scale >= limits.overload_scale_min);
  state.overload_s = too_little ? state.overload_s + dt_s : 0;
  if (state.overload_s <= limits.overload_time_max_s + dt_s / 2) return {};
  return {Fault::kMotorOverload, FaultQuantity::kWeakForceTime, -1, state.overload_s,
          limits.overload_time_max_s};
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

FaultDetail limit_torques(const MechanismLimits& limits, const MotorVector& limit_Nm,
                          const MotorVector& last_Nm, double dt_s, MotorVector& wanted_Nm,
                          MotorState& state) noexcept {
  if (!wanted_Nm.allFinite()) return Fault::kTorqueNotFinite;
  const MotorVector largest_Nm = limits.torque_max_Nm == 0
                                     ? MotorVector(limit_Nm * (1 + 1e-9))
                                     : MotorVector::Constant(limits.torque_max_Nm);
  for (int i = 0; i < kMotors; ++i) {
    if (!(std::abs(wanted_Nm[i]) <= largest_Nm[i])) {
      return {Fault::kTorqueLimit, FaultQuantity::kMotorTorque, i, std::abs(wanted_Nm[i]),
              largest_Nm[i]};
    }
  }
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
  wanted_Nm = tau_Nm.cwiseMax(-limit_Nm).cwiseMin(limit_Nm);  // corrects rounding
  if (state.rise_s <= limits.torque_rise_time_max_s + dt_s / 2) return {};
  return {Fault::kTorqueRate, FaultQuantity::kTorqueRiseTime, -1, state.rise_s,
          limits.torque_rise_time_max_s};
}

}  // namespace trocar::runtime
