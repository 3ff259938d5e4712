// SPDX-License-Identifier: Apache-2.0
#include "tests/stand_ins/simulated_arm.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <utility>

#include "tests/stand_ins/faults.h"

namespace stand_in {
namespace {

constexpr double kStep_s = 1e-4;
constexpr double kMaxGap_s = 1;

Eigen::Quaterniond rotation(const Eigen::Vector3d& vector_rad) {
  const double angle = vector_rad.norm();
  if (angle == 0) return Eigen::Quaterniond::Identity();
  return Eigen::Quaterniond(Eigen::AngleAxisd(angle, vector_rad / angle));
}

Eigen::Vector3d rotation_vector(const Eigen::Quaterniond& q) {
  const Eigen::AngleAxisd turn(q);
  return turn.angle() * turn.axis();
}

Eigen::Vector3d vector_of(const nlohmann::json& entry, const char* key) {
  const auto v = entry.value(key, std::array<double, 3>{});
  return {v[0], v[1], v[2]};
}

}  // namespace

std::vector<Keyframe> read_path(const std::string& file) {
  std::vector<Keyframe> path;
  try {
    std::ifstream stream(file);
    for (const nlohmann::json& entry : nlohmann::json::parse(stream)) {
      path.push_back({entry.at("t_s").get<double>(), vector_of(entry, "position_m"),
                      vector_of(entry, "rotation_vector_rad"),
                      entry.value("buttons", std::uint32_t{0})});
      if (path.size() > 1 && !(path.back().t_s > path[path.size() - 2].t_s))
        throw std::runtime_error("t_s does not ascend");
    }
  } catch (const std::exception& error) {
    throw std::runtime_error(file + ": " + error.what());
  }
  return path;
}

Readings::Readings(std::string_view text) {
  const auto [noise, rest] = split(text, ':');
  const auto [step, late] = split(rest, ':');
  noise_m_ = number_of<double>(noise).value_or(-1);
  step_m_ = number_of<double>(step).value_or(-1);
  late_s_ = number_of<double>(late).value_or(-1);
  if (!(noise_m_ >= 0) || !(step_m_ >= 0) || !(late_s_ >= 0))
    throw std::runtime_error(std::string(text) + " is not NOISE:STEP:LATE");
}

Eigen::Vector3d Readings::of(Eigen::Vector3d position_m) {
  for (double& x : position_m) {
    if (noise_m_ > 0) x += noise_m_ * normal_(random_);
    if (step_m_ > 0) x = step_m_ * std::round(x / step_m_);
  }
  return position_m;
}

SimulatedArm::SimulatedArm(std::vector<Keyframe> path, const ArmSettings& settings)
    : path_(std::move(path)),
      settings_(settings),
      position_m_(target(0).position_m),
      orientation_(rotation(target(0).rotation_vector_rad)) {}

Keyframe SimulatedArm::target(double t_s) const {
  if (path_.empty()) return {};
  const auto next = std::upper_bound(path_.begin(), path_.end(), t_s,
                                     [](double t, const Keyframe& k) { return t < k.t_s; });
  if (next == path_.begin()) return path_.front();
  if (next == path_.end()) return path_.back();
  Keyframe between = *(next - 1);
  const double part = (t_s - between.t_s) / (next->t_s - between.t_s);
  between.position_m += part * (next->position_m - between.position_m);
  between.rotation_vector_rad += part * (next->rotation_vector_rad - between.rotation_vector_rad);
  return between;
}

void SimulatedArm::advance(double t_s, const Eigen::Vector3d& force,
                           const Eigen::Vector3d& moment) {
  t_s_ = std::max(t_s_, t_s - kMaxGap_s);
  while (t_s_ < t_s) {
    const double dt_s = std::min(kStep_s, t_s - t_s_);
    step(dt_s, force, moment);
    t_s_ = dt_s < kStep_s ? t_s : t_s_ + dt_s;
  }
}

void SimulatedArm::step(double dt_s, const Eigen::Vector3d& force, const Eigen::Vector3d& moment) {
  const Keyframe here = target(t_s_);
  const Keyframe there = target(t_s_ + kStep_s);
  const Eigen::Vector3d wanted_velocity = (there.position_m - here.position_m) / kStep_s;
  // The semi-implicit Euler method, with the dampers of the way at the new velocity: stable for every damping.
  const double slowing = 1 + dt_s *
                                 (settings_.damping_N_s_per_m + settings_.hand_damping_N_s_per_m) /
                                 settings_.mass_kg;
  velocity_ =
      (velocity_ + dt_s / settings_.mass_kg *
                       (force + settings_.hand_stiffness_N_per_m * (here.position_m - position_m_) +
                        settings_.hand_damping_N_s_per_m * wanted_velocity)) /
      slowing;
  position_m_ += dt_s * velocity_;

  const Eigen::Quaterniond wanted = rotation(here.rotation_vector_rad);
  const Eigen::Vector3d wanted_rate =
      rotation_vector(rotation(there.rotation_vector_rad) * wanted.conjugate()) / kStep_s;
  rate_ +=
      dt_s / settings_.inertia_kg_m2 *
      (moment +
       settings_.hand_stiffness_Nm_per_rad * rotation_vector(wanted * orientation_.conjugate()) +
       settings_.hand_damping_Nm_s_per_rad * (wanted_rate - rate_));
  orientation_ = (rotation(dt_s * rate_) * orientation_).normalized();
}

}  // namespace stand_in
