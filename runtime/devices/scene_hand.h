// SPDX-License-Identifier: Apache-2.0
// Converts the hand that a scene describes to the simulated hand of runtime/simulation/hand.h.
// Tests: tests/runtime/session/session_test.cpp
#pragma once

#include "formats/session/scene.h"
#include "runtime/simulation/hand.h"

namespace trocar::runtime {

/// Returns the path of the target to which the scene's hand pulls the tool's tip.
HandTrajectory hand_trajectory(const Scene& scene);

/// Returns the impedance of the scene's hand: the values that the scene states, and otherwise those
/// of the hand's grip.
HandImpedance hand_impedance(const SceneHand& hand);

}  // namespace trocar::runtime
