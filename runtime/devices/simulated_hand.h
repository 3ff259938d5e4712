// SPDX-License-Identifier: Apache-2.0
// The simulated device, held by the hand that a scene describes.
// Tests: tests/runtime/session/session_test.cpp
#pragma once

#include <optional>

#include "formats/base/result.h"
#include "formats/session/pose_device_description.h"
#include "formats/session/scene.h"
#include "runtime/simulation/simulated_device.h"
#include "runtime/simulation/simulated_pose_device.h"

namespace trocar::runtime {

/// Makes the simulated device, held by the scene's hand at the hand's first keyframe. If there are
/// no `mechanics`, the light model is used.
Result<SimulatedDevice> make_simulated_device(
    const Scene& scene, const DeviceDescription& description,
    const std::optional<MechanicsOptions>& mechanics = std::nullopt);

/// Like the function above, but `hand` moves the scene's hand. It must outlive the device.
Result<SimulatedDevice> make_simulated_device(const Scene& scene,
                                              const DeviceDescription& description,
                                              UnscriptedHand& hand);

/// Returns where a pose device lies in a scene: the middle of its workspace is the middle of the box around the plate's path by
/// the scene's hand.
PoseFrame pose_frame(const PoseDeviceDescription& description, const Scene& scene);

/// Makes a simulated pose device, held by the scene's hand, or moved by `hand` if that is not null. `hand` must outlive the device.
Result<SimulatedPoseDevice> make_simulated_pose_device(const Scene& scene,
                                                       const PoseDeviceDescription& description,
                                                       UnscriptedHand* hand);

}  // namespace trocar::runtime
