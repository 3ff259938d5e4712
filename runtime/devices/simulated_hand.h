// SPDX-License-Identifier: Apache-2.0
// Makes simulated devices that are held by the hand that a scene describes.
// Tests: tests/runtime/session/session_test.cpp
#pragma once

#include <optional>

#include "formats/base/result.h"
#include "formats/session/pose_device_description.h"
#include "formats/session/scene.h"
#include "runtime/simulation/simulated_device.h"
#include "runtime/simulation/simulated_pose_device.h"

namespace trocar::runtime {

/// Makes a simulated four-legged device. The scene's hand holds it, beginning at the hand's first
/// keyframe. If `mechanics` is empty, the device is the light model of simulated_device.h.
Result<SimulatedDevice> make_simulated_device(
    const Scene& scene, const DeviceDescription& description,
    const std::optional<MechanicsOptions>& mechanics = std::nullopt);

/// Like the function above, but the hand follows `hand` instead of the scene's keyframes, and the
/// device is always the light model. `hand` must outlive the device.
Result<SimulatedDevice> make_simulated_device(const Scene& scene,
                                              const DeviceDescription& description,
                                              UnscriptedHand& hand);

/// Returns where a pose device lies in a scene. The middle of the device's workspace is placed at
/// the middle of the box around the path on which the scene's hand moves the plate.
PoseFrame pose_frame(const PoseDeviceDescription& description, const Scene& scene);

/// Makes a simulated pose device, which the scene's hand holds. If `hand` is not null, the hand
/// follows `hand` instead of the scene's keyframes. `hand` must outlive the device.
Result<SimulatedPoseDevice> make_simulated_pose_device(const Scene& scene,
                                                       const PoseDeviceDescription& description,
                                                       UnscriptedHand* hand);

}  // namespace trocar::runtime
