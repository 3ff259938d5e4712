// SPDX-License-Identifier: Apache-2.0
// Makes the tissue of a scene from a fitted curve: an object for `tissue` of
// formats/session/scene.schema.json.
//
// tool_in_tissue.h computes forces from a tissue and a tool. This file inverts that computation for
// the tool with which the curve was measured. The tissue has these members:
//  - strength_MPa: the cutting force divided by the area that the tool displaces. The cutting force
//    includes tearing and friction on the tip's faces, so the tissue has no values for these two.
//  - friction_kPa: the friction per length divided by the tool's circumference
//  - modulus_MPa: computed from the stiffness with Poisson's ratio 0.3
//  - stiffness_N_per_m and threshold_N: the stiffness and the cutting force of the fit
// The tissue has no member bed_N_per_mm3, because the curve does not show how stiff the walls of
// the hole are. The tissue is valid for tools of a similar shape and size.
// Tests: tests/runtime/calibration/fitted_tissue_test.cpp
#pragma once

#include <string>

#include "formats/base/result.h"
#include "formats/session/scene.h"
#include "runtime/calibration/curve_fit.h"

namespace trocar::runtime {

/// Reads the tool from a file that holds a scene, or only the object `tool` of a scene. Errors:
/// kRefused if the file cannot be read; those of parse_scene() and tool_shape().
Result<SceneTool> read_fit_tool(const std::filesystem::path& file);

/// Returns the tissue as JSON with a line feed at its end. The function checks the tissue with
/// parse_scene(). Errors: those of tool_shape(); kRefused if a value is outside the range that a
/// scene allows. The messages do not contain the file's name.
Result<std::string> fitted_tissue(const CurveFit& fit, const SceneTool& tool);

/// Returns the hard layer of the fit as the object `shell` of a scene's `body`, in one line of
/// JSON. Returns an empty text if the curve shows no hard layer, or if the thickness or strength of
/// the layer is outside the range that a scene allows.
std::string fitted_shell(const CurveFit& fit);

}  // namespace trocar::runtime
