// SPDX-License-Identifier: Apache-2.0
// Converts the hand that a scene describes to the simulated hand of runtime/simulation/hand.h.
#pragma once

#include "formats/session/scene.h"
#include "runtime/simulation/hand.h"

namespace trocar::runtime {

/// Returns the keyframes of the scene's hand as the path of a target. The simulated hand pulls the
/// tool's tip to this target.
HandTrajectory hand_trajectory(const Scene& scene);

/// Returns the impedance of the scene's hand (stiffness, damping and mass). A value that the scene
/// does not state is taken from the hand's grip.
HandImpedance hand_impedance(const SceneHand& hand);

}  // namespace trocar::runtime
