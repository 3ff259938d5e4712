// SPDX-License-Identifier: Apache-2.0
// Makes simulated devices. A scene describes a simulated hand (SceneHand), which holds and moves
// such a device.
#pragma once

#include <optional>

#include "formats/base/result.h"
#include "formats/session/pose_device_description.h"
#include "formats/session/scene.h"
#include "runtime/simulation/simulated_device.h"
#include "runtime/simulation/simulated_pose_device.h"

namespace trocar::runtime {

/// Makes a simulated four-legged device. The scene's hand holds the device, beginning at the hand's
/// first keyframe. If `mechanics` is nullopt, the device is the light model of simulated_device.h,
/// in which only the plate has mass. Errors: those of SimulatedDevice::make().
Result<SimulatedDevice> make_simulated_device(
    const Scene& scene, const DeviceDescription& description,
    const std::optional<MechanicsOptions>& mechanics = std::nullopt);

/// Like the function above, but the targets of the hand come from `hand` instead of the scene's
/// keyframes, and the device is always the light model. `hand` must outlive the device.
Result<SimulatedDevice> make_simulated_device(const Scene& scene,
                                              const DeviceDescription& description,
                                              UnscriptedHand& hand);

/// Returns the frame that places a pose device in a scene. The keyframes of the scene's hand give
/// positions of the plate (of a pose device, the plate is its handle). The frame is chosen so that
/// the middle of the box around these positions coincides with the middle of the device's
/// workspace.
PoseFrame pose_frame(const PoseDeviceDescription& description, const Scene& scene);

/// Makes a simulated pose device, which the scene's hand holds. If `hand` is not null, the targets
/// of the hand come from `hand` instead of the scene's keyframes, and `hand` must outlive the
/// device. Errors: those of SimulatedPoseDevice::make().
Result<SimulatedPoseDevice> make_simulated_pose_device(const Scene& scene,
                                                       const PoseDeviceDescription& description,
                                                       UnscriptedHand* hand);

}  // namespace trocar::runtime
