// SPDX-License-Identifier: Apache-2.0
// The simulated device, held by the hand that a scene describes.
// Tests: tests/runtime/session/session_test.cpp
#pragma once

#include <optional>

#include "formats/base/result.h"
#include "formats/session/device_description.h"
#include "formats/session/scene.h"
#include "runtime/simulation/simulated_device.h"

namespace trocar::runtime {

/// Returns the path along which the scene's hand pulls the tool's tip.
HandTrajectory hand_trajectory(const Scene& scene);

/// Returns the impedance of the scene's hand.
HandImpedance hand_impedance(const SceneHand& hand);

/// Makes the simulated device, held by the scene's hand at the hand's first keyframe. If there are
/// no `mechanics`, the light model is used.
Result<SimulatedDevice> make_simulated_device(
    const Scene& scene, const DeviceDescription& description,
    const std::optional<MechanicsOptions>& mechanics = std::nullopt);

/// Like the function above, but `hand` moves the scene's hand. It must outlive the device.
Result<SimulatedDevice> make_simulated_device(const Scene& scene,
                                              const DeviceDescription& description,
                                              UnscriptedHand& hand);

}  // namespace trocar::runtime
