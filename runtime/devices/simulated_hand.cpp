// SPDX-License-Identifier: Apache-2.0
#include "runtime/devices/simulated_hand.h"

#include <Eigen/Geometry>
#include <functional>
#include <vector>

#include "runtime/contact/tool.h"
#include "runtime/devices/scene_hand.h"

namespace trocar::runtime {
namespace {

Result<SimulatedDevice> make(const Scene& scene, const DeviceDescription& description,
                             const HandMotion& motion,
                             const std::optional<MechanicsOptions>& mechanics) {
  SimulatedDeviceOptions options;
  options.mechanics = mechanics;
  options.T_plate_tool.p_m = Eigen::Vector3d(scene.tool.tip_in_plate_m.data());
  return SimulatedDevice::make(description, motion, hand_impedance(scene.hand), options);
}

}  // namespace

Result<SimulatedDevice> make_simulated_device(const Scene& scene,
                                              const DeviceDescription& description,
                                              const std::optional<MechanicsOptions>& mechanics) {
  return make(scene, description, hand_trajectory(scene), mechanics);
}

Result<SimulatedDevice> make_simulated_device(const Scene& scene,
                                              const DeviceDescription& description,
                                              UnscriptedHand& hand) {
  return make(scene, description, std::ref(hand), std::nullopt);
}

PoseFrame pose_frame(const PoseDeviceDescription& description, const Scene& scene) {
  const std::vector<HandKeyframe> path = hand_trajectory(scene).keyframes;
  if (path.empty()) return {description, Pose{}};
  const Tool tool = make_tool(scene.tool);
  Eigen::AlignedBox3d box;
  for (const HandKeyframe& each : path)
    box.extend(each.T_device_tool.p_m - each.T_device_tool.q * tool.tip_plate_m);
  return {description, Pose{box.center(), path.front().T_device_tool.q}};
}

Result<SimulatedPoseDevice> make_simulated_pose_device(const Scene& scene,
                                                       const PoseDeviceDescription& description,
                                                       UnscriptedHand* hand) {
  Pose T_plate_tool;
  T_plate_tool.p_m = Eigen::Vector3d(scene.tool.tip_in_plate_m.data());
  const HandMotion motion =
      hand != nullptr ? HandMotion(std::ref(*hand)) : HandMotion(hand_trajectory(scene));
  return SimulatedPoseDevice::make(description, pose_frame(description, scene), motion,
                                   hand_impedance(scene.hand), T_plate_tool);
}

}  // namespace trocar::runtime
