// SPDX-License-Identifier: Apache-2.0
#include "runtime/pose_device/pose_frame.h"

namespace trocar::runtime {
namespace {

Eigen::Vector3d vector(const std::array<double, 3>& values) noexcept {
  return {values[0], values[1], values[2]};
}

}  // namespace

PoseFrame::PoseFrame(const PoseDeviceDescription& description, const Pose& T_device_plate_middle)
    : description_(description),
      centre_(T_device_plate_middle),
      middle_m_((vector(description.workspace_min_m) + vector(description.workspace_max_m)) / 2),
      q_B_device_(from_rotation_vector(vector(description.turn_rad))) {}

Pose PoseFrame::plate(const PoseReading& reading) const noexcept {
  Pose T;
  T.p_m = centre_.p_m + q_B_device_ * (vector(reading.p_m) - middle_m_);
  T.q = centre_.q;
  if (!description_.senses_rotation) return T;
  const Eigen::Quaterniond q_device_handle(reading.q[0], reading.q[1], reading.q[2], reading.q[3]);
  T.q = (q_B_device_ * q_device_handle * q_B_device_.conjugate() * centre_.q).normalized();
  return T;
}

PoseReading PoseFrame::reading(const Pose& T_device_plate) const noexcept {
  PoseReading reading;
  const Eigen::Vector3d p_m =
      middle_m_ + q_B_device_.conjugate() * (T_device_plate.p_m - centre_.p_m);
  reading.p_m = {p_m.x(), p_m.y(), p_m.z()};
  if (!description_.senses_rotation) return reading;
  const Eigen::Quaterniond q =
      (q_B_device_.conjugate() * T_device_plate.q * centre_.q.conjugate() * q_B_device_)
          .normalized();
  reading.q = {q.w(), q.x(), q.y(), q.z()};
  return reading;
}

HandleWrench PoseFrame::to_device(const Wrench& wrench) const noexcept {
  const Eigen::Vector3d f = q_B_device_.conjugate() * Eigen::Vector3d(wrench.head<3>());
  const Eigen::Vector3d n = q_B_device_.conjugate() * Eigen::Vector3d(wrench.tail<3>());
  return {f.x(), f.y(), f.z(), n.x(), n.y(), n.z()};
}

Wrench PoseFrame::from_device(const HandleWrench& wrench) const noexcept {
  Wrench out;
  out << q_B_device_ * Eigen::Vector3d(wrench[0], wrench[1], wrench[2]),
      q_B_device_ * Eigen::Vector3d(wrench[3], wrench[4], wrench[5]);
  return out;
}

PoseFrame::Box PoseFrame::workspace() const noexcept {
  const Eigen::Vector3d half_m =
      (vector(description_.workspace_max_m) - vector(description_.workspace_min_m)) / 2;
  const Eigen::Vector3d reach_m = q_B_device_.toRotationMatrix().cwiseAbs() * half_m;
  return {centre_.p_m - reach_m, centre_.p_m + reach_m};
}

}  // namespace trocar::runtime
