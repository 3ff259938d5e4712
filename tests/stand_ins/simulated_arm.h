// SPDX-License-Identifier: Apache-2.0
// An arm and a hand that hold the handle of a haptic device: a rigid body on a spring and a damper, which pull it to
// a path of keyframes, and on which the device's force and moment act.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <random>
#include <string>
#include <string_view>
#include <vector>

namespace stand_in {

struct Keyframe {
  double t_s = 0;
  Eigen::Vector3d position_m = Eigen::Vector3d::Zero();
  Eigen::Vector3d rotation_vector_rad = Eigen::Vector3d::Zero();
  std::uint32_t buttons = 0;
};

/// Reads [{"t_s", "position_m", "rotation_vector_rad", "buttons"}, ...]; all but t_s, which ascends, are optional.
/// Throws std::runtime_error with one line.
std::vector<Keyframe> read_path(const std::string& file);

/// A firm hand with a desktop device.
struct ArmSettings {
  double mass_kg = 0.3;
  double damping_N_s_per_m = 0;  ///< of the arm alone
  double hand_stiffness_N_per_m = 2000;
  double hand_damping_N_s_per_m = 40;
  double inertia_kg_m2 = 2e-4;
  double hand_stiffness_Nm_per_rad = 3;
  double hand_damping_Nm_s_per_rad = 0.03;
};

/// How a device reads a position, always with the same noise.
class Readings {
 public:
  Readings() = default;
  /// "NOISE:STEP:LATE": standard deviation and smallest step (m), and the longest time (s) by which
  /// a reading comes late; each is late by another time. Throws std::runtime_error with one line.
  explicit Readings(std::string_view text);

  Eigen::Vector3d of(Eigen::Vector3d position_m);
  double late_s() { return late_s_ * uniform_(random_); }

 private:
  double noise_m_ = 0, step_m_ = 0, late_s_ = 0;
  std::mt19937_64 random_{1};
  std::normal_distribution<double> normal_;
  std::uniform_real_distribution<double> uniform_;
};

class SimulatedArm {
 public:
  /// An empty path holds the handle at the origin. Time begins at 0.
  explicit SimulatedArm(std::vector<Keyframe> path, const ArmSettings& settings = {});
  /// Moves on to time `t_s` with a constant force (N) and moment (N*m). At most the last second of a gap is simulated.
  void advance(double t_s, const Eigen::Vector3d& force, const Eigen::Vector3d& moment);

  double t_s() const { return t_s_; }
  const Eigen::Vector3d& position_m() const { return position_m_; }
  const Eigen::Vector3d& velocity_m_per_s() const { return velocity_; }
  const Eigen::Quaterniond& orientation() const { return orientation_; }
  /// The buttons of the last keyframe that has been reached.
  std::uint32_t buttons() const { return target(t_s_).buttons; }

 private:
  Keyframe target(double t_s) const;
  void step(double dt_s, const Eigen::Vector3d& force, const Eigen::Vector3d& moment);

  std::vector<Keyframe> path_;
  ArmSettings settings_;
  double t_s_ = 0;
  Eigen::Vector3d position_m_;
  Eigen::Vector3d velocity_ = Eigen::Vector3d::Zero();
  Eigen::Quaterniond orientation_;
  Eigen::Vector3d rate_ = Eigen::Vector3d::Zero();
};

}  // namespace stand_in
