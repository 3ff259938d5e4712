// SPDX-License-Identifier: Apache-2.0
// The hand that a scene describes.
// Tests: tests/runtime/session/session_test.cpp
#pragma once

#include "formats/session/scene.h"
#include "runtime/simulation/hand.h"

namespace trocar::runtime {

/// Returns the path along which the scene's hand pulls the tool's tip.
HandTrajectory hand_trajectory(const Scene& scene);

/// Returns the impedance of the scene's hand.
HandImpedance hand_impedance(const SceneHand& hand);

}  // namespace trocar::runtime
