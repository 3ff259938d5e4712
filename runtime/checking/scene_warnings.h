// SPDX-License-Identifier: Apache-2.0
// The warnings of `trocar-run check`. To add a warning, write a function in scene_warnings.cpp
// and call it in find_warnings().
#pragma once

#include <string>
#include <vector>

#include "runtime/checking/scene_evaluation.h"
#include "runtime/checking/tissue_assignment.h"
#include "runtime/devices/live_hand.h"

namespace trocar::runtime {

/// Returns the warnings. Each warning is a line with position, value, limit and advice.
std::vector<std::string> find_warnings(const SceneEvaluation& evaluation,
                                       const std::vector<SliceTissue>& tissues);

/// Returns the warnings of a scene with a live hand. `hand`: result of live_hand_limits().
std::vector<std::string> find_live_hand_warnings(const SceneEvaluation& evaluation,
                                                 const std::vector<SliceTissue>& tissues,
                                                 const Result<LiveHandLimits>& hand);

}  // namespace trocar::runtime
