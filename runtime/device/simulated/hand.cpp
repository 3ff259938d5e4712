// SPDX-License-Identifier: Apache-2.0
#include "runtime/device/simulated/hand.h"

namespace trocar::runtime {

namespace {

std::span<const HandKeyframe> keyframes_of(const HandMotion& motion) noexcept {
  const auto* const trajectory = std::get_if<HandTrajectory>(&motion);
  return trajectory != nullptr ? std::span(trajectory->keyframes) : std::span<const HandKeyframe>();
}

}  // namespace

HandTarget hand_target(const HandTrajectory& trajectory, double t_s) noexcept {
  const auto& keyframes = trajectory.keyframes;
  HandTarget target;
  if (keyframes.empty()) return target;
  const auto after =
      std::upper_bound(keyframes.begin(), keyframes.end(), t_s,
                       [](double t, const HandKeyframe& keyframe) { return t < keyframe.t_s; });
  if (after == keyframes.begin() || after == keyframes.end()) {
    target.T_device_tool =
        (after == keyframes.begin() ? keyframes.front() : keyframes.back()).T_device_tool;
    return target;
  }
  const HandKeyframe& a = *(after - 1);
  const HandKeyframe& b = *after;
  const double span_s = b.t_s - a.t_s;
  const double s = (t_s - a.t_s) / span_s;
  double progress = s, rate = 1 / span_s;
  if (trajectory.interpolation == HandInterpolation::kMinimumJerk) {
    progress = s * s * s * (10 + s * (-15 + 6 * s));
    rate = 30 * s * s * (1 - s) * (1 - s) / span_s;
  }
  const Eigen::Vector3d move = b.T_device_tool.p_m - a.T_device_tool.p_m;
  const Eigen::Vector3d rotation =
      rotation_vector(b.T_device_tool.q * a.T_device_tool.q.conjugate());
  target.T_device_tool.p_m = a.T_device_tool.p_m + progress * move;
  target.T_device_tool.q =
      (from_rotation_vector(progress * rotation) * a.T_device_tool.q).normalized();
  target.twist_device << rate * move, rate * rotation;
  return target;
}

HandTarget hand_target(const HandMotion& motion, double t_s) noexcept {
  const auto* const unscripted = std::get_if<1>(&motion);
  return unscripted != nullptr ? unscripted->get().target(t_s)
                               : hand_target(*std::get_if<HandTrajectory>(&motion), t_s);
}

std::optional<Pose> hand_start(const HandMotion& motion) noexcept {
  if (const auto* const unscripted = std::get_if<1>(&motion)) return unscripted->get().start();
  const std::span<const HandKeyframe> keyframes = keyframes_of(motion);
  return keyframes.empty() ? std::nullopt : std::optional(keyframes.front().T_device_tool);
}

bool hand_holds(const HandMotion& motion, const HandImpedance& impedance, double t_s) noexcept {
  return std::holds_alternative<std::reference_wrapper<UnscriptedHand>>(motion) ||
         (!keyframes_of(motion).empty() && t_s < impedance.let_go_t_s);
}

Wrench hand_wrench(const HandImpedance& impedance, const HandTarget& target,
                   const Pose& T_device_tool, const Twist& twist_tool) noexcept {
  const Twist lag = target.twist_device - twist_tool;
  const Eigen::Vector3d rotation =
      rotation_vector(target.T_device_tool.q * T_device_tool.q.conjugate());
  Wrench wrench;
  wrench << impedance.stiffness_N_per_m * (target.T_device_tool.p_m - T_device_tool.p_m) +
                impedance.damping_Ns_per_m * lag.head<3>(),
      impedance.rotational_stiffness_Nm_per_rad * rotation +
          impedance.rotational_damping_Nms_per_rad * lag.tail<3>();
  return wrench;
}

Result<void> check_hand(const HandMotion& motion, const HandImpedance& impedance) {
  const std::span<const HandKeyframe> keyframes = keyframes_of(motion);
  for (std::size_t i = 0; i < keyframes.size(); ++i) {
    const HandKeyframe& keyframe = keyframes[i];
    const std::string where = "hand: keyframe " + std::to_string(i);
    if (!std::isfinite(keyframe.t_s) || !is_finite(keyframe.T_device_tool))
      return refused(where + ": not finite");
    if (std::abs(keyframe.T_device_tool.q.squaredNorm() - 1) > 1e-9)
      return refused(where + ": quaternion is not of unit length");
    if (i > 0 && !(keyframe.t_s > keyframes[i - 1].t_s))
      return refused(where + ": time does not increase");
  }
  const double parts[] = {impedance.stiffness_N_per_m, impedance.damping_Ns_per_m,
                          impedance.rotational_stiffness_Nm_per_rad,
                          impedance.rotational_damping_Nms_per_rad, impedance.mass_kg};
  for (const double part : parts) {
    if (!std::isfinite(part) || part < 0)
      return refused("hand: stiffness, damping and mass must be finite and not negative");
  }
  if (std::isnan(impedance.let_go_t_s)) return refused("hand: let_go_t_s is not a number");
  return {};
}

}  // namespace trocar::runtime
