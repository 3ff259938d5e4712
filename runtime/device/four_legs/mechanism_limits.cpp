// SPDX-License-Identifier: Apache-2.0
#include "runtime/device/four_legs/mechanism_limits.h"

namespace trocar::runtime {

Singularity measure_singularity(const DeviceDescription& device, const Pose& T_device_plate,
                                const JointAngles& joints, const Jacobian& G) noexcept {
  Singularity out;
  const SingularRange range = singular_range(G);
  out.smallest_singular_value_per_m = range.smallest;
  out.inverse_condition = range.largest > 0 ? range.smallest / range.largest : 0;

  const DeviceGeometry& g = device.geometry;
  out.nearest_branch_m = std::numeric_limits<double>::infinity();
  const auto nearest = [&out](double distance_m, int leg, int joint) {
    if (distance_m >= out.nearest_branch_m) return;
    out.nearest_branch_m = distance_m;
    out.nearest_leg = static_cast<std::int8_t>(leg + 1);
    out.nearest_joint = static_cast<std::int8_t>(joint);
  };
  for (int m = 0; m < kLegs; ++m) {
    const Eigen::Vector3d C = leg::to_leg(m, T_device_plate * leg::plate_joint(g, m));
    const Eigen::Vector3d D = leg::link_joint(g, leg::elbow(g, joints.theta_rad[m][0]), C);
    const Eigen::Vector3d p = C - leg::upper_motor(g), q = D - leg::lower_motor(g);
    BranchDistance& distance = out.branch[m];
    distance.theta1_m = leg::branch_distance(p.x(), p.z(), p.y(), g.l1_m, g.l2_m);
    distance.theta4_m = leg::branch_distance(q.x(), q.y(), q.z(), g.l3_m, g.l4_m);
    nearest(distance.theta1_m, m, 1);
    nearest(distance.theta4_m, m, 4);
  }
  return out;
}

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
