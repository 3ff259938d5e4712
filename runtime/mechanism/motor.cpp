// SPDX-License-Identifier: Apache-2.0
#include "runtime/mechanism/motor.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace trocar::runtime {
namespace {

MotorVector capacity_A2s(const MotorModel& model) noexcept {
  return (model.peak_A.cwiseAbs2() - model.continuous_A.cwiseAbs2()) * model.peak_time_s;
}

// Returns the available fraction of the range between continuous and peak current: 1 while the peak
// is available, 0 when the i2t capacity is used up.
double peak_fraction(double excess_A2s, double capacity_A2s) noexcept {
  if (!(capacity_A2s > 0)) return 0;
  return std::clamp((1 - excess_A2s / capacity_A2s) / kFoldBack, 0.0, 1.0);
}

}  // namespace

MotorModel make_motor_model(const DeviceDescription& device) noexcept {
  MotorModel model;
  for (int i = 0; i < kMotors; ++i) {
    const bool upper = i == motor_index(i / 2, 0);
    model.Nm_per_A[i] = device.motor_torque_constant_Nm_per_A * device.motor_gear_ratio *
                        (upper ? device.upper_bevel_ratio : 1);
    model.peak_Nm[i] =
        std::min(device.motor_peak_torque_Nm, device.motor_peak_current_A * model.Nm_per_A[i]);
    model.peak_A[i] = model.peak_Nm[i] / model.Nm_per_A[i];
    model.continuous_A[i] =
        std::min({device.motor_continuous_current_A,
                  device.motor_continuous_torque_Nm / model.Nm_per_A[i], model.peak_A[i]});
  }
  model.peak_time_s = device.motor_peak_time_s;
  model.coulomb_Nm = device.joint_coulomb_friction_Nm;
  model.viscous_Nms_per_rad = device.joint_viscous_friction_Nms_per_rad;
  return model;
}

MotorVector motor_currents(const MotorModel& model, const MotorVector& tau_motor_Nm) noexcept {
  return tau_motor_Nm.cwiseQuotient(model.Nm_per_A);
}

MotorLoad advance(const MotorModel& model, const MotorLoad& load, const MotorVector& current_A,
                  double dt_s) noexcept {
  MotorLoad next;
  for (int i = 0; i < kMotors; ++i) {
    const double current = std::isfinite(current_A[i]) ? current_A[i] : model.peak_A[i];
    const double beyond = current * current - model.continuous_A[i] * model.continuous_A[i];
    // The square of an unphysically large current may overflow.
    next.excess_A2s[i] =
        std::clamp(load.excess_A2s[i] + beyond * dt_s, 0.0, std::numeric_limits<double>::max());
  }
  return next;
}

double i2t_fraction_used(const MotorModel& model, const MotorLoad& load, int* hottest) noexcept {
  const MotorVector capacity = capacity_A2s(model);
  double most = 0;
  for (int i = 0; i < kMotors; ++i) {
    const double share = capacity[i] > 0 ? load.excess_A2s[i] / capacity[i] : 0;
    if (share > most && hottest != nullptr) *hottest = i;
    most = std::max(most, share);
  }
  return most;
}

MotorVector available_current(const MotorModel& model, const MotorLoad& load) noexcept {
  const MotorVector capacity = capacity_A2s(model);
  MotorVector current_A;
  for (int i = 0; i < kMotors; ++i) {
    const double share = peak_fraction(load.excess_A2s[i], capacity[i]);
    const double low2 = model.continuous_A[i] * model.continuous_A[i];
    const double high2 = model.peak_A[i] * model.peak_A[i];
    current_A[i] = share >= 1 ? model.peak_A[i] : std::sqrt(low2 + share * (high2 - low2));
  }
  return current_A;
}

MotorVector available_torque(const MotorModel& model, const MotorLoad& load) noexcept {
  const MotorVector current_A = available_current(model, load);
  MotorVector tau_Nm = current_A.cwiseProduct(model.Nm_per_A).cwiseMin(model.peak_Nm);
  for (int i = 0; i < kMotors; ++i) {
    if (current_A[i] == model.peak_A[i]) tau_Nm[i] = model.peak_Nm[i];
  }
  return tau_Nm;
}

MotorVector compensation_torques(const DeviceDescription& device, const MotorModel& model,
                                 const Jacobian& G, const MotorVector& motor_rad_per_s,
                                 const CompensationOptions& options) noexcept {
  MotorVector tau_Nm = MotorVector::Zero();
  if (options.friction && motor_rad_per_s.allFinite()) {
    const double still = std::max(options.still_rad_per_s, 1e-9);
    const MotorVector direction = (motor_rad_per_s / still).cwiseMin(1).cwiseMax(-1);
    tau_Nm += options.friction_fraction *
              (model.coulomb_Nm * direction + model.viscous_Nms_per_rad * motor_rad_per_s);
  }
  if (options.gravity) {
    Wrench hold = Wrench::Zero();
    hold[2] = device.plate_mass_kg * device.gravity_m_per_s2;
    tau_Nm += allocate_torques(G, hold, model.peak_Nm).tau_motor_Nm;
  }
  return tau_Nm;
}

AllocationResult allocate_torques_with_bias(const Jacobian& G, const Wrench& wrench_device,
                                            const MotorVector& limit_Nm,
                                            const MotorVector& bias_Nm) noexcept {
  if (!bias_Nm.allFinite()) return {};
  AllocationResult result =
      allocate_torques(G, wrench_device, MotorVector(limit_Nm - bias_Nm.cwiseAbs()));
  if (result.kind == AllocationKind::kRefused) return result;
  // Here the limits can be exceeded by rounding only.
  result.tau_motor_Nm = (result.tau_motor_Nm + bias_Nm).cwiseMin(limit_Nm).cwiseMax(-limit_Nm);
  return result;
}

}  // namespace trocar::runtime
