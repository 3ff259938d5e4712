// SPDX-License-Identifier: Apache-2.0
// The simulated arm: a point mass with small damping, held by a simulated hand, which is a spring and a damper to a
// target that follows keyframes. Everything is in the arm's frame and in SI units.
#pragma once

#include <array>
#include <string>
#include <vector>

namespace trocar::haply_stand_in {

using Vec3 = std::array<double, 3>;
using Quaternion = std::array<double, 4>;  // w x y z

struct Keyframe {
  double t_s = 0;
  Vec3 position_m{};
  Vec3 rotation_vector_rad{};
  unsigned buttons = 0;  // bit i: button i is pressed, from this keyframe to the next one
};

/// Target of the hand at one time.
struct HandTarget {
  Vec3 position_m{}, velocity_m_per_s{};
  Quaternion orientation{1, 0, 0, 0};
  unsigned buttons = 0;
};

/// Reads keyframes from a JSON file: a list of {"t_s", "position_m", "rotation_vector_rad" (optional), "buttons"
/// (optional)}, whose times start at 0 or later and ascend. Throws std::runtime_error with one line.
std::vector<Keyframe> read_keyframes(const std::string& file);

/// Returns the target at a time. It is linear between keyframes, and stays at the first and last one outside of them.
HandTarget target_at(const std::vector<Keyframe>& keyframes, double t_s);

struct ArmSettings {
  double mass_kg = 0.2;
  double damping_N_s_per_m = 1;
  double hand_stiffness_N_per_m = 300;
  double hand_damping_N_s_per_m = 8;  // acts on the velocity relative to the target
  double idle_after_s = 0.02;         // a force ends if no message follows for this long
};

/// The force that the motors give: the commanded one, but at most 50 N.
Vec3 motor_force(Vec3 commanded_N);
/// Time by which the arm advances at most for one message, so that a machine that stood still causes no jump.
inline constexpr double kMaxCatchUp_s = 0.05;

class Arm {
 public:
  Arm(const ArmSettings& settings, std::vector<Keyframe> keyframes);

  /// Advances by `elapsed_s`, but at most by kMaxCatchUp_s, under a force of the motors that began at the start of
  /// this time.
  void advance(double elapsed_s, const Vec3& motor_N);

  double time_s() const { return time_s_; }  ///< sum of all advances
  const Vec3& position_m() const { return position_m_; }
  const Vec3& velocity_m_per_s() const { return velocity_m_per_s_; }
  const HandTarget& hand() const { return hand_; }

 private:
  ArmSettings settings_;
  std::vector<Keyframe> keyframes_;
  double time_s_ = 0;
  HandTarget hand_;
  Vec3 position_m_, velocity_m_per_s_{};
};

}  // namespace trocar::haply_stand_in
