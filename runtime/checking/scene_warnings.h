// SPDX-License-Identifier: Apache-2.0
// The warnings of `trocar-run --check`. To add a warning, write a function in scene_warnings.cpp and
// call it in find_warnings().
// Tests: tests/e2e/scene_check_e2e_test.py
#pragma once

#include <string>
#include <vector>

#include "runtime/checking/scene_evaluation.h"
#include "runtime/checking/tissue_assignment.h"

namespace trocar::runtime {

/// Returns the warnings. Each is a line with position, value, limit and advice.
std::vector<std::string> find_warnings(const SceneEvaluation& evaluation,
                                       const std::vector<SliceTissue>& tissues);

}  // namespace trocar::runtime
