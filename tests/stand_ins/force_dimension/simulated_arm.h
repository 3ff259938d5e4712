// SPDX-License-Identifier: Apache-2.0
// An arm and a hand that hold the handle of a haptic device: a rigid body on a spring and a damper, which pull it to
// a path of keyframes, and on which the device's force and moment act.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <vector>

namespace stand_in {

struct Keyframe {
  double t_s = 0;
  Eigen::Vector3d position_m = Eigen::Vector3d::Zero();
  Eigen::Vector3d rotation_vector_rad = Eigen::Vector3d::Zero();
  std::uint32_t buttons = 0;
};

// A firm hand with a desktop device. README.md states these values.
inline constexpr double kMass_kg = 0.3;
inline constexpr double kStiffness_N_per_m = 2000;
inline constexpr double kDamping_N_s_per_m = 40;
inline constexpr double kInertia_kg_m2 = 2e-4;
inline constexpr double kStiffness_Nm_per_rad = 3;
inline constexpr double kDamping_Nm_s_per_rad = 0.03;

class SimulatedArm {
 public:
  /// `path` is in ascending order of time. An empty one holds the handle at the origin. Time begins at 0.
  explicit SimulatedArm(std::vector<Keyframe> path);
  /// Moves on to time `t_s` with a constant force (N) and moment (N*m). At most the last second of a gap is simulated.
  void advance(double t_s, const Eigen::Vector3d& force, const Eigen::Vector3d& moment);

  const Eigen::Vector3d& position_m() const { return position_m_; }
  const Eigen::Quaterniond& orientation() const { return orientation_; }
  /// The buttons of the last keyframe that has been reached.
  std::uint32_t buttons() const { return target(t_s_).buttons; }

 private:
  Keyframe target(double t_s) const;
  void step(double dt_s, const Eigen::Vector3d& force, const Eigen::Vector3d& moment);

  std::vector<Keyframe> path_;
  double t_s_ = 0;
  Eigen::Vector3d position_m_;
  Eigen::Vector3d velocity_ = Eigen::Vector3d::Zero();
  Eigen::Quaterniond orientation_;
  Eigen::Vector3d rate_ = Eigen::Vector3d::Zero();
};

}  // namespace stand_in
