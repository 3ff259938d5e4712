// SPDX-License-Identifier: Apache-2.0
#include "runtime/device/simulated_device.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>

#include "runtime/device/jacobian.h"

namespace trocar::runtime {
namespace {

using Eigen::Vector3d;

constexpr int kMostSubsteps = 100000;  // kLongestStep_s over the shortest maximum_substep_s

Vector3d plate_inertia(const DeviceDescription& device) noexcept {
  return Vector3d(device.plate_inertia_kg_m2[0], device.plate_inertia_kg_m2[1],
                  device.plate_inertia_kg_m2[2]);
}

double kinetic_energy(const DeviceDescription& device, const Pose& T, const Twist& twist) noexcept {
  const Vector3d omega_plate = T.q.conjugate() * Vector3d(twist.tail<3>());
  return 0.5 * (device.plate_mass_kg * twist.head<3>().squaredNorm() +
                omega_plate.dot(plate_inertia(device).cwiseProduct(omega_plate)));
}

Twist moved_to(const Twist& twist, const Vector3d& lever_m) noexcept {
  Twist moved = twist;
  moved.head<3>() += Vector3d(twist.tail<3>()).cross(lever_m);
  return moved;
}

}  // namespace

Result<SimulatedDevice> SimulatedDevice::make(const DeviceDescription& device,
                                              const HandTrajectory& trajectory,
                                              const HandImpedance& impedance,
                                              const SimulatedDeviceOptions& options) {
  if (auto checked = check_hand(trajectory, impedance); !checked) return checked.error();
  SimulatedDevice simulated(device, trajectory, impedance, options);
  Pose& T = simulated.truth_.T_device_plate;
  if (options.T_device_plate_start) {
    T = *options.T_device_plate_start;
  } else if (!trajectory.keyframes.empty()) {
    T = trajectory.keyframes.front().T_device_tool * inverse(options.T_plate_tool);
  } else {
    T.p_m.z() = kSimulatedHomeHeight_m;
  }
  const InverseResult start = inverse_kinematics(device, T);
  if (!start.status) {
    return refused("simulated device: the start pose is " +
                   std::string(to_string(start.status.failure)) + " (leg " +
                   std::to_string(start.status.leg) + ", theta" +
                   std::to_string(start.status.joint) + ")");
  }
  simulated.truth_.joints = start.joints;
  return simulated;
}

DeviceStatus SimulatedDevice::read(DeviceState& state) noexcept {
  state.t_s = truth_.t_s;
  state.encoder_rad = encoder_angles(truth_.joints);
  if (device_.encoder_counts_per_revolution > 0) {
    const double count_rad = 2 * std::numbers::pi / device_.encoder_counts_per_revolution;
    for (double& angle : state.encoder_rad)
      angle = std::round(angle / count_rad) * count_rad;
  }
  return DeviceStatus::kOk;
}

DeviceStatus SimulatedDevice::write(const DeviceCommand& command) noexcept {
  MotorVector tau;
  for (int i = 0; i < kMotors; ++i)
    tau[i] = command.tau_motor_Nm[i];
  truth_.command_refused = !tau.allFinite();
  if (truth_.command_refused) tau.setZero();
  const double peak = device_.motor_peak_torque_Nm;
  truth_.torque_limited = options_.limit_torque && tau.cwiseAbs().maxCoeff() > peak;
  if (truth_.torque_limited) tau = tau.cwiseMin(peak).cwiseMax(-peak);
  truth_.tau_motor_Nm = tau;
  return DeviceStatus::kOk;
}

bool SimulatedDevice::step(double dt_s) noexcept {
  if (!(dt_s > 0 && dt_s <= kLongestStep_s)) return false;
  const double wanted = std::ceil(dt_s / device_.maximum_substep_s);
  const int substeps =
      std::max(device_.minimum_substeps, static_cast<int>(std::min<double>(wanted, kMostSubsteps)));
  const double h_s = dt_s / substeps;
  truth_.at_stop = false;
  for (int i = 0; i < substeps; ++i)
    substep(truth_.t_s + i * h_s, h_s);
  truth_.t_s += dt_s;
  truth_.kinetic_J = kinetic_energy(device_, truth_.T_device_plate, truth_.twist_device);
  return true;
}

void SimulatedDevice::substep(double t_s, double h_s) noexcept {
  const Pose T = truth_.T_device_plate;
  const Twist before = truth_.twist_device;
  const Vector3d lever_m = T.q * options_.T_plate_tool.p_m;

  // What acts on the plate. At a singular pose motors and friction have no
  // defined ratio to the plate's motion; it counts as an end of reach.
  const JacobianResult motion = jacobian(device_, T, truth_.joints);
  const Jacobian G = motion.status ? motion.G : Jacobian::Zero();
  truth_.wrench_motors = G.transpose() * truth_.tau_motor_Nm;
  const Wrench friction =
      -device_.joint_viscous_friction_Nms_per_rad * (G.transpose() * (G * before));
  truth_.wrench_hand.setZero();
  if (!trajectory_.keyframes.empty()) {
    truth_.wrench_hand = hand_wrench(impedance_, hand_target(trajectory_, t_s),
                                     T * options_.T_plate_tool, moved_to(before, lever_m));
  }
  const Wrench hand = moved_by(truth_.wrench_hand, lever_m);
  Wrench gravity = Wrench::Zero();
  gravity[2] = -device_.plate_mass_kg * device_.gravity_m_per_s2;
  const Wrench total = truth_.wrench_motors + friction + hand + gravity;

  // Momentum first, then the pose by the new velocity. The angular momentum is
  // kept in {B}, so that gyroscopic moments need no term of their own.
  const Vector3d inertia = plate_inertia(device_);
  const auto momentum = [&](const Eigen::Quaterniond& q, const Vector3d& omega) -> Vector3d {
    return q * Vector3d(inertia.cwiseProduct(q.conjugate() * omega));
  };
  const auto rate = [&](const Eigen::Quaterniond& q, const Vector3d& L) -> Vector3d {
    return q * Vector3d((q.conjugate() * L).cwiseQuotient(inertia));
  };
  const Vector3d L = momentum(T.q, before.tail<3>()) + h_s * total.tail<3>();
  Twist after;
  after.head<3>() = before.head<3>() + (h_s / device_.plate_mass_kg) * total.head<3>();
  after.tail<3>() = rate(T.q, L);
  Pose moved;
  moved.p_m = T.p_m + h_s * after.head<3>();
  moved.q = (from_rotation_vector(h_s * after.tail<3>()) * T.q).normalized();

  const Twist middle = 0.5 * (before + after);
  EnergyBook& work = truth_.work;
  work.hand_J += h_s * hand.dot(middle);
  work.motors_J += h_s * truth_.wrench_motors.dot(middle);
  work.friction_J += h_s * friction.dot(middle);
  work.gravity_J += h_s * gravity.dot(middle);

  const InverseResult reached = inverse_kinematics(device_, moved);
  if (!motion.status || !reached.status) {
    work.stop_J -= kinetic_energy(device_, T, after);
    truth_.twist_device.setZero();
    truth_.at_stop = true;
    return;
  }
  after.tail<3>() = rate(moved.q, L);  // the same momentum in the turned body
  truth_.T_device_plate = moved;
  truth_.twist_device = after;
  truth_.joints = reached.joints;
}

}  // namespace trocar::runtime
