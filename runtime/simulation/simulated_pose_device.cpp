// SPDX-License-Identifier: Apache-2.0
#include "runtime/simulation/simulated_pose_device.h"

#include <algorithm>
#include <cmath>

namespace trocar::runtime {
namespace {

constexpr double kLongestSubstep_s = 1e-4;
/// A longer step would only follow from a stopped process; the rest of its time is lost.
constexpr double kLongestStep_s = 0.1;

double rounded_to(double value, double resolution) noexcept {
  return resolution > 0 ? std::round(value / resolution) * resolution : value;
}

}  // namespace

Result<SimulatedPoseDevice> SimulatedPoseDevice::make(const PoseDeviceDescription& description,
                                                      const PoseFrame& frame,
                                                      const HandMotion& motion,
                                                      const HandImpedance& impedance,
                                                      const Pose& T_plate_tool) {
  if (auto checked = check_hand(motion, impedance); !checked) return checked.error();
  SimulatedPoseDevice made(description, frame, motion, impedance, T_plate_tool);
  made.T_ = hand_start(motion).value_or(Pose{}) * inverse(T_plate_tool);
  return made;
}

DeviceStatus SimulatedPoseDevice::read(PoseReading& reading) noexcept {
  reading = frame_.reading(T_);
  reading.t_s = std::round(t_s_ * 1e9) / 1e9;
  for (double& at_m : reading.p_m)
    at_m = rounded_to(at_m, description_.position_resolution_m);
  if (!description_.senses_rotation || description_.rotation_resolution_rad == 0)
    return DeviceStatus::kOk;
  Eigen::Vector4d q;
  for (int i = 0; i < 4; ++i)
    q[i] = rounded_to(reading.q[static_cast<std::size_t>(i)],
                      description_.rotation_resolution_rad / 2);
  q.normalize();
  reading.q = {q[0], q[1], q[2], q[3]};
  return DeviceStatus::kOk;
}

DeviceStatus SimulatedPoseDevice::write(const HandleWrench& wrench) noexcept {
  command_ = frame_.from_device(wrench);
  if (!command_.allFinite()) command_.setZero();
  return DeviceStatus::kOk;
}

/// Returns the hand's wrench on the plate about its origin.
Wrench SimulatedPoseDevice::hand(double t_s) const noexcept {
  if (!hand_holds(motion_, impedance_, t_s)) return Wrench::Zero();
  const HandTarget target = hand_target(motion_, t_s);
  const Eigen::Vector3d lever_m = T_.q * T_plate_tool_.p_m;
  Twist tip = twist_;
  tip.head<3>() += Eigen::Vector3d(twist_.tail<3>()).cross(lever_m);
  return moved_by(hand_wrench(impedance_, target, T_ * T_plate_tool_, tip), lever_m);
}

void SimulatedPoseDevice::advance(double dt_s) noexcept {
  if (!(dt_s > 0)) return;
  const double step_s = std::min(dt_s, kLongestStep_s);
  const int substeps = std::max(1, static_cast<int>(std::ceil(step_s / kLongestSubstep_s - 1e-9)));
  if (const auto* const unscripted = std::get_if<1>(&motion_))
    unscripted->get().begin_step(t_s_, step_s, T_ * T_plate_tool_);
  for (int i = 0; i < substeps; ++i)
    substep(t_s_ + i * step_s / substeps, step_s / substeps);
  t_s_ += dt_s;
}

void SimulatedPoseDevice::substep(double t_s, double h_s) noexcept {
  // Damping by device and hand is implicit, so that it is stable for any mass. The hand's wrench contains its own.
  const bool holds = hand_holds(motion_, impedance_, t_s);
  const double hand_N_s_per_m = holds ? impedance_.damping_Ns_per_m : 0;
  const double hand_Nm_s_per_rad = holds ? impedance_.rotational_damping_Nms_per_rad : 0;
  Wrench total = command_ + hand(t_s);
  total.head<3>() += hand_N_s_per_m * twist_.head<3>();
  total.tail<3>() += hand_Nm_s_per_rad * twist_.tail<3>();
  const double rate = h_s / description_.mass_kg;
  twist_.head<3>() = (twist_.head<3>() + rate * total.head<3>()) /
                     (1 + rate * (description_.damping_N_s_per_m + hand_N_s_per_m));
  T_.p_m += h_s * twist_.head<3>();
  if (!description_.senses_rotation) return;
  for (int i = 0; i < 3; ++i) {
    const double turn = h_s / description_.inertia_kg_m2[static_cast<std::size_t>(i)];
    twist_[3 + i] = (twist_[3 + i] + turn * total[3 + i]) /
                    (1 + turn * (description_.rotation_damping_Nm_s_per_rad + hand_Nm_s_per_rad));
  }
  T_.q = (from_rotation_vector(h_s * twist_.tail<3>()) * T_.q).normalized();
}

}  // namespace trocar::runtime
