// SPDX-License-Identifier: Apache-2.0
#include "tests/stand_ins/haply/arm.h"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <utility>

namespace trocar::haply_stand_in {
namespace {

constexpr double kMaxStep_s = 1e-4, kMaxMotorForce_N = 50;

Quaternion quaternion_of(const Vec3& rotation_vector_rad) {
  const auto& r = rotation_vector_rad;
  const double angle = std::hypot(r[0], r[1], r[2]);
  const double factor = angle < 1e-9 ? 0.5 : std::sin(angle / 2) / angle;
  return {std::cos(angle / 2), factor * r[0], factor * r[1], factor * r[2]};
}

}  // namespace

Vec3 motor_force(Vec3 commanded_N) {
  const double norm = std::hypot(commanded_N[0], commanded_N[1], commanded_N[2]);
  if (norm > kMaxMotorForce_N)
    for (double& component : commanded_N)
      component *= kMaxMotorForce_N / norm;
  return commanded_N;
}

std::vector<Keyframe> read_keyframes(const std::string& file) {
  std::ifstream stream(file);
  if (!stream) throw std::runtime_error(file + ": cannot be opened");
  std::vector<Keyframe> keyframes;
  try {
    for (const auto& entry : nlohmann::json::parse(stream)) {
      Keyframe keyframe;
      keyframe.t_s = entry.at("t_s").get<double>();
      keyframe.position_m = entry.at("position_m").get<Vec3>();
      keyframe.rotation_vector_rad = entry.value("rotation_vector_rad", Vec3{});
      keyframe.buttons = entry.value("buttons", 0u);
      if (keyframe.t_s < 0 || (!keyframes.empty() && keyframe.t_s <= keyframes.back().t_s))
        throw std::runtime_error(file + ": the times of keyframes must ascend from 0");
      keyframes.push_back(keyframe);
    }
  } catch (const nlohmann::json::exception& error) {
    throw std::runtime_error(file + ": " + error.what());
  }
  if (keyframes.empty()) throw std::runtime_error(file + ": has no keyframes");
  return keyframes;
}

HandTarget target_at(const std::vector<Keyframe>& keyframes, double t_s) {
  const auto next =
      std::upper_bound(keyframes.begin(), keyframes.end(), t_s,
                       [](double t, const Keyframe& keyframe) { return t < keyframe.t_s; });
  const Keyframe& from = next == keyframes.begin() ? *next : *std::prev(next);
  const Keyframe& to = next == keyframes.end() ? from : *next;
  HandTarget target;
  target.buttons = from.buttons;
  const double span_s = to.t_s - from.t_s;
  const double part = span_s > 0 ? (t_s - from.t_s) / span_s : 0;
  Vec3 rotation{};
  for (std::size_t i = 0; i < 3; ++i) {
    const double way_m = to.position_m[i] - from.position_m[i];
    target.position_m[i] = from.position_m[i] + part * way_m;
    if (span_s > 0) target.velocity_m_per_s[i] = way_m / span_s;
    const double turn = to.rotation_vector_rad[i] - from.rotation_vector_rad[i];
    rotation[i] = from.rotation_vector_rad[i] + part * turn;
  }
  target.orientation = quaternion_of(rotation);
  return target;
}

Arm::Arm(const ArmSettings& settings, std::vector<Keyframe> keyframes)
    : settings_(settings),
      keyframes_(std::move(keyframes)),
      hand_(target_at(keyframes_, 0)),
      position_m_(hand_.position_m) {}

void Arm::advance(double elapsed_s, const Vec3& motor_N) {
  elapsed_s = std::clamp(elapsed_s, 0.0, kMaxCatchUp_s);
  const int steps = static_cast<int>(std::ceil(elapsed_s / kMaxStep_s));
  const double dt_s = steps > 0 ? elapsed_s / steps : 0;
  // The semi-implicit Euler method, with dampers at the new velocity: it is stable for every damping.
  const double slowing = 1 + dt_s *
                                 (settings_.damping_N_s_per_m + settings_.hand_damping_N_s_per_m) /
                                 settings_.mass_kg;
  for (int step = 0; step < steps; ++step) {
    const bool is_idle = step * dt_s >= settings_.idle_after_s;
    hand_ = target_at(keyframes_, time_s_ + (step + 1) * dt_s);
    for (std::size_t i = 0; i < 3; ++i) {
      const double force =
          (is_idle ? 0 : motor_N[i]) +
          settings_.hand_stiffness_N_per_m * (hand_.position_m[i] - position_m_[i]) +
          settings_.hand_damping_N_s_per_m * hand_.velocity_m_per_s[i];
      velocity_m_per_s_[i] = (velocity_m_per_s_[i] + dt_s * force / settings_.mass_kg) / slowing;
      position_m_[i] += dt_s * velocity_m_per_s_[i];
    }
  }
  time_s_ += elapsed_s;
}

}  // namespace trocar::haply_stand_in
