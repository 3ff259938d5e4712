// SPDX-License-Identifier: Apache-2.0
#include "runtime/devices/scene_hand.h"

#include <numbers>

namespace trocar::runtime {

HandTrajectory hand_trajectory(const Scene& scene) {
  HandTrajectory trajectory;
  for (const TipKeyframe& keyframe : scene.hand.trajectory) {
    HandKeyframe frame;
    frame.t_s = keyframe.t_s;
    frame.T_device_tool.p_m = Eigen::Vector3d(keyframe.tip_m.data());
    frame.T_device_tool.q = from_rotation_vector(Eigen::Vector3d(keyframe.rotation_deg.data()) *
                                                 (std::numbers::pi / 180));
    trajectory.keyframes.push_back(frame);
  }
  return trajectory;
}

HandImpedance hand_impedance(const SceneHand& hand) {
  HandImpedance impedance = hand.grip == HandGrip::kLight   ? light_grip()
                            : hand.grip == HandGrip::kStiff ? stiff_grip()
                                                            : HandImpedance{};
  impedance.stiffness_N_per_m = hand.stiffness_N_per_m.value_or(impedance.stiffness_N_per_m);
  impedance.damping_Ns_per_m = hand.damping_N_s_per_m.value_or(impedance.damping_Ns_per_m);
  impedance.rotational_stiffness_Nm_per_rad =
      hand.rotation_stiffness_Nm_per_rad.value_or(impedance.rotational_stiffness_Nm_per_rad);
  impedance.rotational_damping_Nms_per_rad =
      hand.rotation_damping_Nm_s_per_rad.value_or(impedance.rotational_damping_Nms_per_rad);
  impedance.mass_kg = hand.mass_kg.value_or(impedance.mass_kg);
  impedance.let_go_t_s = hand.let_go_t_s.value_or(impedance.let_go_t_s);
  return impedance;
}

}  // namespace trocar::runtime
