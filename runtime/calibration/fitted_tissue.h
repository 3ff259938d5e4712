// SPDX-License-Identifier: Apache-2.0
// The tissue of a scene from a fitted curve: an object for `tissue` of formats/session/scene.schema.json.
//
// Inverts tool_in_tissue.h for the tool that the curve was measured with. The cutting force becomes strength_MPa over
// the displaced area, without separate tearing and face friction; the friction per length becomes friction_kPa over
// the circumference; the stiffness becomes modulus_MPa with Poisson's ratio 0.3, and stiffness_N_per_m. Walls
// (bed_N_per_mm3) cannot be known from such a curve and are left out. The tissue holds for tools of a similar shape and size.
// Tests: tests/runtime/calibration/fitted_tissue_test.cpp
#pragma once

#include <string>

#include "formats/base/result.h"
#include "formats/session/scene.h"
#include "runtime/calibration/curve_fit.h"

namespace trocar::runtime {

/// The tool of a scene, read from a file that holds a scene or only its `tool`. Errors: (refused) those of
/// parse_scene() and tool_shape().
Result<SceneTool> read_fit_tool(const std::filesystem::path& file);

/// The tissue as JSON with a line feed at its end; parse_scene() has accepted it. Errors: (refused, without the
/// file's name) those of tool_shape(); a value that is out of a scene's range.
Result<std::string> fitted_tissue(const CurveFit& fit, const SceneTool& tool);

/// The hard layer as `shell` of a scene's `body`, in one line of JSON; empty: the curve shows none, or it is out of a
/// scene's range.
std::string fitted_shell(const CurveFit& fit);

}  // namespace trocar::runtime
